"""The page about a run: complete, self-contained, safe with what others wrote, during a run as
after it.
"""

import dataclasses
import json
import re
import shutil
import subprocess
from html import unescape
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_search.report.page import run_html, write_run_page
from ibrid_search.report.run_data import read_run
from ibrid_search.run.store import Store
from ibrid_search.step import Status, Step
from ibrid_search.watching.run_state import run_state
from made_run import REFUSALS, a_run, meta, put
from page_reader import Reader, self_contained

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.formats.csv_file import read_csv, write_sweep
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.plants.benchmarks import benchmarks
from ibrid.report.look.numbers import error
from ibrid.structure.diagrams.library import textbook, textbook_text
from ibrid.structure.diagrams.program import parse_program

HOSTILE = '<script>alert("x")</script>&'


def read(path: Path) -> Reader:
    return self_contained(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A run with the hidden structure given as the truth."""
    return a_run(
        tmp_path_factory.mktemp("runs") / "run", meta(truth=textbook_text("gfl_pll_filter_exact"))
    )


@pytest.fixture(scope="module")
def page(folder) -> str:
    return write_run_page(folder).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def reader(page) -> Reader:
    return self_contained(page)


@pytest.fixture
def few_figures(monkeypatch):
    """Leaves out the frequency responses, which take most of the time, where a test is about
    something else.
    """
    monkeypatch.setattr("ibrid_search.report.models.POINTS", 0)


@pytest.mark.slow
def test_page_begins_with_the_verdict(reader):
    words = reader.text
    assert words.index("reproduces the measurement to rounding") < words.index("evaluations")
    assert "Found in evaluation 4. It is the structure that was given as the truth." in words


@pytest.mark.slow
def test_page_shows_milestones_with_the_band_that_got_better(reader, folder):
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        run = read_run(store)
    assert [one.step for one in run.milestones] == [0, 1, 3, 5]
    assert all(one.band for one in run.milestones[1:])
    for one in run.milestones[1:]:
        assert f"{one.band.replace('-', '–')} Hz" in reader.text
        assert reader.text.count(one.note) >= 3  # figure, table, lineage


@pytest.mark.slow
def test_page_draws_start_found_and_truth_and_compares_them(reader):
    diagrams = [one for one in reader.all("svg") if "diagram" in (one.get("class") or "").split()]
    assert len(diagrams) == 3
    assert "The start" in reader.text
    assert "The given truth" in reader.text
    assert "The found structure is the given one." in reader.text
    assert "1.00 / 1.00" in reader.text


@pytest.mark.slow
def test_page_compares_responses_at_every_operating_point(reader, page):
    for op in benchmark().names:
        for entry in ("dd", "dq", "qd", "qq"):
            assert (
                f"Bode plot of Y_{entry} at {op}: measured, found, start, given truth (refitted)."
                in page
            )
    assert "given truth (refitted)" in reader.text


@pytest.mark.slow
def test_page_shows_errors_parameters_and_every_way_an_edit_changed_the_program(reader, page):
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    shown = {float(one["value"] or "nan") for one in reader.all("data")}
    assert set(record.nrmse_by_op.values()) <= shown
    assert {value for values in record.parameters.values() for value in values.values()} <= shown
    assert (
        len(reader.all("details")) == 4 + 4
    )  # the edits; numbers, errors, statistics and settings of the run
    assert '+    g.add("LPF1", "pll_filter")' in unescape(page)


@pytest.mark.slow
def test_page_counts_endings_proposers_and_islands(reader):
    words = reader.text
    for status in REFUSALS.values():
        assert re.search(rf"{status} \d+ \S+ %? ?\w", words), status
    assert "1 × reason 2" in words
    assert "How 6 proposals ended." in words
    assert "4 of 40" in words
    assert 'proposer = "rules"' in words
    assert "the text to replace is not in the program" in words
    template = (files("ibrid_search") / "templates" / "run.html").read_text(encoding="utf-8")
    assert all(f'"{status}": "' in template for status in Status)  # every one has a meaning


@pytest.mark.slow
def test_figures_and_tables_can_be_read_without_seeing(reader):
    pictures = [one for one in reader.all("svg") if one.get("aria-hidden") != "true"]
    assert len(pictures) == 3 + 8 + 3  # diagrams, entries at two points, trajectory and two fronts
    assert all(one.get("role") == "img" and one.get("aria-label") for one in pictures)
    assert all(one.get("scope") in ("row", "col", "rowgroup") for one in reader.all("th"))


@pytest.mark.slow
def test_page_follows_the_colours_of_the_reader(page):
    assert not re.findall(r"#0[1-6]0[0-9][0-9a-f]{2}\b", page.split("</style>")[1])


@pytest.mark.slow
def test_selection_of_the_run_decides_the_answer_and_its_columns(folder, tmp_path, few_figures):
    shutil.copytree(folder, tmp_path / "run")
    front = [
        {
            "step": 3,
            "nrmse": 0.006,
            "order": 12,
            "free_parameters": 12,
            "holdout": 0.0123,
            "stable": True,
            "passivity": -0.456,
            "phase_margin": None,
            "note": "a remark",
        },
        {
            "step": 5,
            "nrmse": 1e-15,
            "order": 13,
            "free_parameters": 13,
            "holdout": None,
            "stable": True,
            "passivity": None,
        },
    ]
    chosen = {
        "front": front,
        "equally_good": [3, 5],
        "answer": 3,
        "why": "A reason.",
        "residual_modules": ["rest"],
    }
    (tmp_path / "run" / "selection.json").write_text(json.dumps(chosen), encoding="utf-8")
    words = read(write_run_page(tmp_path / "run")).text
    assert "Found in evaluation 3" in words
    assert "It is not the structure that was given as the truth." in words
    assert "1 other structure fits equally well." in words
    for part in (
        "A reason.",
        "held out",
        "0.0123",
        "passivity",
        "-0.456",
        "a remark",
        "the answer, fits equally well",
    ):
        assert part in words
    assert (
        "phase margin" not in words.partition("Structures that no simpler one beats")[2]
    )  # a column without a number
    assert "Residual modules, which stand for no physics: rest." in words


@pytest.mark.slow
def test_a_line_begins_at_the_shipped_diagram_that_it_came_from(tmp_path, few_figures):
    folder = a_run(tmp_path / "run", meta(), shipped=(1,))
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        run = read_run(store)
    assert run.start.number == 1
    errors = {number: step.nrmse for number, step in run.steps.items()}
    assert [(one.step, one.before) for one in run.milestones] == [
        (0, None),
        (1, None),
        (3, errors[1]),
        (5, errors[3]),
    ]
    assert run.milestones[1].band == ""
    words = read(write_run_page(folder)).text
    assert "2 edits lead from the shipped diagram gfl_exact to what was found" in words
    way = words.partition("2 edits lead")[2].partition("How the search went")[0]
    assert "decoupling by the nominal frequency" in way
    assert "evaluation 1" not in way
    assert [one["parent"] for one in run_state(folder)["nodes"]] == [None, None, 1, 3]


@pytest.mark.slow
def test_page_begins_with_sentence_grade_diagram_and_line_and_folds_its_statistics(page):
    marks = (
        'class="verdict"',
        "<dt>grade",
        "<summary>The search in numbers",
        'id="diagram"',
        '<th scope="row">PLL',
        'id="lineage"',
        'id="trajectory"',
        '<details><summary><h2 id="error-heading',
    )
    order = [page.index(mark) for mark in marks]
    assert order == sorted(order)
    head = page[page.index("<header>") : page.index("</header>")]
    assert head.partition("<details>")[0].count("<dt>") == 5
    assert "evaluations per second" not in head.partition("<details>")[0]


@pytest.mark.slow
def test_a_page_says_why_the_answer_is_not_the_lowest_of_the_curve(tmp_path, few_figures):
    folder = a_run(tmp_path / "run", meta())
    title = "Why the final number is not the last of the curve"
    assert title not in read(write_run_page(folder)).text
    chosen = {"front": [{"step": 3}], "equally_good": [3], "answer": 3, "why": "it was asked for"}
    (folder / "selection.json").write_text(json.dumps(chosen), encoding="utf-8")
    words = read(write_run_page(folder)).text
    low, high = (evaluated(name, restarts=0) for name in ("gfl_pll_filter_exact", "gfl"))
    assert title in words
    assert (
        f"The curve goes down to {error(low.nrmse)} at evaluation 4; the answer is evaluation 3 "
        f"with {error(high.nrmse)}."
    ) in words
    assert f"{low.free_parameters} free parameters against {high.free_parameters}" in words
    assert "The answer was chosen since it was asked for." in words
    better = dataclasses.replace(high, nrmse=0.5 * (high.nrmse or 0.0))
    better.write(folder / "best.json")
    words = read(write_run_page(folder)).text
    assert f"best.json has {error(better.nrmse)}: after the search the answer was fitted" in words
    low.write(folder / "best.json")  # of another structure: nothing is said of it
    assert "best.json has" not in read(write_run_page(folder)).text


@pytest.mark.slow
def test_a_page_counts_in_evaluations_alone(page, folder):
    words = read(write_run_page(folder)).text
    assert not re.search(r"\bsteps? \d", words)
    assert "<dt>proposals" not in page


@pytest.mark.slow
def test_structures_that_miss_the_data_alike_are_not_said_to_fit(folder, tmp_path, few_figures):
    a_run(tmp_path / "run", meta(), until=3)  # the best of these misses clean data by 0.2 %
    chosen = {"front": [{"step": 3}], "equally_good": [0, 1, 3], "answer": 3}
    (tmp_path / "run" / "selection.json").write_text(json.dumps(chosen), encoding="utf-8")
    words = read(write_run_page(tmp_path / "run")).text
    said = "No structure fits the data exactly yet, and their noise is not known;"
    assert f"{said} 2 others are about equally near." in words
    assert f"{said} 3 are about equally near, evaluations 1, 2, 3." in words
    assert "fit equally well" not in words
    assert "tell them apart" not in words


@pytest.mark.slow
@pytest.mark.parametrize(("noise_db", "explained"), [(40.0, True), (80.0, False)])
def test_what_explains_the_data_depends_on_their_noise(tmp_path, few_figures, noise_db, explained):
    sweep = add_noise(benchmark(), noise_db, rng=np.random.default_rng(0))
    write_sweep(sweep, tmp_path / "data.csv")
    (tmp_path / "run").mkdir()
    with Store.create(
        tmp_path / "run" / "archive.sqlite", meta(data=(tmp_path / "data.csv").read_text())
    ) as store:
        for number, name in enumerate(("naive", "gfl")):
            record = evaluate(textbook(name), sweep, restarts=0)
            put(store, Step(number, status=Status.OK, program=record.program), record)
    chosen = {"front": [{"step": 1}], "equally_good": [0, 1], "answer": 1}
    (tmp_path / "run" / "selection.json").write_text(json.dumps(chosen), encoding="utf-8")
    words = read(write_run_page(tmp_path / "run")).text
    assert ("1 other structure fits equally well." in words) is explained
    assert (
        "No structure explains the data yet; 1 other is about equally near." in words
    ) is not explained


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"front": 3}',
        '{"front": [{"nrmse": 1}]}',
        '{"front": [], "answer": "x"}',
        "[" * 9999,
    ],
)
def test_a_damaged_selection_is_said_on_the_page_and_the_steps_decide(folder, tmp_path, text):
    shutil.copytree(folder, tmp_path / "run")
    (tmp_path / "run" / "selection.json").write_text(text, encoding="utf-8")
    with Store.open(tmp_path / "run" / "archive.sqlite", read_only=True) as store:
        run = read_run(store)
    assert any("selection.json" in note for note in run.notes)
    assert run.answer is not None
    assert run.answer.number == 5


@pytest.mark.slow
def test_page_of_a_run_that_has_only_begun(tmp_path, few_figures):
    words = read(write_run_page(a_run(tmp_path / "run", meta(), until=0))).text
    assert "It is the start itself: nothing better has been found." in words
    assert "Nothing has been proposed yet." in words


def test_page_of_an_empty_run(tmp_path, few_figures):
    words = read(write_run_page(a_run(tmp_path / "run", meta(), until=-1))).text
    assert "No stable candidate has been fitted yet" in words
    assert "Nothing has been evaluated yet." in words


@pytest.mark.slow
def test_page_of_a_run_without_a_valid_candidate_says_why(tmp_path):
    (tmp_path / "run").mkdir()
    failed = evaluate(parse_program('def b(g):\n    g.add("Gain_dq", "k")\n'), benchmark())
    with Store.create(
        tmp_path / "run" / "archive.sqlite", meta(truth=textbook_text("gfl"))
    ) as store:
        put(
            store,
            Step(
                0,
                status=Status.FAILED,
                program=textbook_text("naive"),
                reason="no real operating point",
            ),
            failed,
        )
        put(
            store,
            Step(1, parent=0, status=Status.ILLEGAL, reason="a wire is missing", proposer="random"),
        )
        put(store, Step(2, parent=0, status=Status.PENDING, proposer="random"))
    words = read(write_run_page(tmp_path / "run")).text
    assert "Nothing found yet" in words
    assert "no real operating point" in words
    assert "a wire is missing" in words
    assert "The given truth" in words  # still drawn


@pytest.mark.slow
def test_an_unstable_candidate_is_shown_and_is_not_the_answer(tmp_path):
    folder = a_run(tmp_path / "run", meta(), until=1)
    good = evaluated("gfl_pll_filter_exact", restarts=0)
    unstable = dataclasses.replace(good, stable=dict.fromkeys(good.stable, False))
    with Store.open(folder / "archive.sqlite") as store:
        step = Step(7, parent=1, status=Status.OK, program=textbook_text("gfl_pll_filter_exact"))
        put(store, step, unstable)
        run = read_run(store)
    assert run.answer is not None
    assert run.answer.number == 1
    assert run.points[-1].nrmse == good.nrmse
    assert run.points[-1].best == run.answer.nrmse


@pytest.mark.slow
def test_what_others_wrote_is_shown_and_never_becomes_markup(tmp_path, few_figures):
    changes = {
        "note": HOSTILE,
        "reason": HOSTILE,
        "proposer": HOSTILE,
        "scale": HOSTILE,
        "diagnosis": HOSTILE,
    }
    folder = a_run(
        tmp_path / "run", meta(settings=f'evil = """{HOSTILE}"""', started=HOSTILE), **changes
    )
    path = write_run_page(folder)
    assert HOSTILE not in path.read_text(encoding="utf-8")
    assert read(path).text.count(HOSTILE) > 15


def test_a_truth_that_cannot_be_read_or_fitted_is_said_on_the_page(tmp_path):
    folder = a_run(tmp_path / "run", meta(truth="import os\n"), until=1)
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        run = read_run(store)
        assert run.truth is None
        assert any("the given truth, line 1" in note for note in run.notes)
    with Store.open(folder / "archive.sqlite") as store:
        store.set_meta("truth", 'def b(g):\n    g.add("Gain_dq", "k")\n')
        run = read_run(store)
        assert run.truth is not None
        assert any("has no fit (invalid)" in note for note in run.notes)


@pytest.mark.slow
def test_data_that_cannot_be_read_leave_the_model_lines(tmp_path, monkeypatch):
    monkeypatch.setattr("ibrid_search.report.models.POINTS", 1)
    folder = a_run(tmp_path / "run", meta(data="op,p\n"), until=1)
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        run = read_run(store)
    assert run.sweep is None
    assert any("no measured dots" in note for note in run.notes)
    words = run_html(run)
    first, second = benchmark().names
    assert f"Bode plot of Y_dd at {first}" in words
    assert f"Not drawn: {second}." in words
    assert ">measured<" not in words


def test_the_data_in_the_run_are_those_of_the_sweep(tmp_path):
    write_sweep(benchmark(), tmp_path / "data.csv")
    folder = a_run(
        tmp_path / "run", meta(data=(tmp_path / "data.csv").read_text(encoding="utf-8")), until=0
    )
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        run = read_run(store)
    assert run.sweep is not None
    for op in benchmark().names:
        assert (
            run.sweep.point(op).admittance
            == read_csv(benchmarks()["paper_like"]).point(op).admittance
        ).all()


@pytest.mark.slow
def test_page_is_written_while_another_writes_the_run(tmp_path, few_figures):
    folder = a_run(tmp_path / "run", meta(), until=0)
    with Store.open(folder / "archive.sqlite") as store:
        put(store, Step(1, parent=0, status=Status.PENDING))
        assert write_run_page(folder) == folder / "report.html"
        put(store, Step(2, parent=0, status=Status.ILLEGAL))


@pytest.mark.slow
def test_a_folder_without_a_run_and_a_place_that_cannot_be_written_are_one_sentence(
    folder, tmp_path, few_figures
):
    with pytest.raises(IbridError):
        write_run_page(tmp_path)
    with (
        Store.open(folder / "archive.sqlite", read_only=True) as store,
        pytest.raises(IbridError, match="no folder"),
    ):
        write_run_page(store, tmp_path / "no" / "such" / "page.html")


@pytest.mark.nightly
def test_ten_thousand_steps_give_a_page_below_the_limit(folder, tmp_path, few_figures):
    shutil.copytree(folder, tmp_path / "run")
    with Store.open(tmp_path / "run" / "archive.sqlite") as store:
        record = evaluated("naive", restarts=0).to_json()
        for number in range(10, 2010):
            put(
                store,
                Step(
                    number,
                    parent=0,
                    status=Status.PENDING,
                    note=f"edit {number}",
                    island=number % 10,
                ),
            )
            store.conclude(
                number, status=Status.OK, record={**record, "nrmse": 0.2 + number / 2000}
            )
        for number in range(2010, 10_000):
            put(
                store,
                Step(
                    number,
                    parent=3,
                    status=Status.ILLEGAL,
                    reason=f"reason {number}",
                    proposer="random",
                ),
            )
    path = write_run_page(tmp_path / "run")
    shown = (
        path.read_text(encoding="utf-8").split('<section id="statistics"')[1].split("</section>")[0]
    )
    assert len(shown) < 100_000
    assert "2004, budget 40" in read(path).text


@pytest.mark.slow
def test_page_says_how_the_run_ended_what_the_archive_held_and_what_was_begun_again(
    tmp_path, few_figures
):
    held = {
        "entries": 212,
        "unstable": 31,
        "elites": 181,
        "admitted": 220,
        "evicted": 8,
        "migrations": 3,
        "natives": [1],
    }
    texts = meta(archive=json.dumps(held), ending="the budget is spent", seconds="12.0")
    folder = a_run(tmp_path / "run", texts, until=1)
    with Store.open(folder / "archive.sqlite") as store:
        for number, attempts in ((2, 3), (3, 1), (4, 2)):
            store.propose(Step(number, parent=0))
            store.conclude(number, status=Status.FAILED, attempts=attempts)
    text = read(write_run_page(folder)).text
    assert "ended since the budget is spent" in text
    assert "2 candidates were begun 5 times in all" in text
    assert "structures kept unstable among them elites admitted in all evicted migrations" in text
    assert "212 31 181 220 8 3" in text


@pytest.mark.slow
@pytest.mark.parametrize("archive", ["", "{", "[1]", '{"entries": "many"}'])
def test_a_run_that_says_nothing_of_its_archive_has_no_table_of_it(tmp_path, few_figures, archive):
    folder = a_run(tmp_path / "run", meta(archive=archive), until=1)
    text = read(write_run_page(folder)).text
    assert "structures kept" not in text
    assert "ended since" not in text
    assert "begun" not in text


@pytest.mark.slow
def test_page_tells_what_language_models_have_taken(tmp_path, few_figures):
    folder = a_run(tmp_path / "run", meta(), until=1)
    with Store.open(folder / "archive.sqlite") as store:
        for number in (2, 3):
            used = {"model": "small", "prompt_tokens": 1000, "cost": 0.25, "retries": 0}
            store.propose(Step(number, parent=0, status=Status.NO_EDIT, usage=used))
    text = read(write_run_page(folder)).text
    assert "prompt tokens 2,000 cost 0.5" in text
    assert "retries" not in text


@pytest.mark.slow
def test_headless_browser_renders_the_page(page, tmp_path):
    browser = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if browser is None:
        pytest.skip(
            "chromium is not installed, so the page is not rendered; apt-get install chromium"
        )
    source, picture = tmp_path / "page.html", tmp_path / "page.png"
    source.write_text(page, encoding="utf-8")
    options = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        f"--user-data-dir={tmp_path / 'profile'}",
    ]
    command = [
        browser,
        *options,
        f"--screenshot={picture}",
        "--window-size=1200,2000",
        source.as_uri(),
    ]
    subprocess.run(command, check=True, timeout=600, capture_output=True)
    from matplotlib.image import imread

    pixels = (255 * imread(picture)[::3, ::3, :3]).round().astype(int).reshape(-1, 3)
    assert len({tuple(one) for one in pixels}) > 50  # a blank page has one
