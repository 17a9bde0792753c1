"""`ibrid start`: from a file to a first answer, its page, its model and the commands that go on."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from browser import asked
from foreign_files import MAKES
from ibrid_bench.events.cases import draw
from ibrid_search.starting.start import START_EFFORTS, start
from ibrid_search.starting.start_files import write_start
from ibrid_search.starting.start_result import DiagramFit, StartResult
from jsonschema import Draft202012Validator
from page_reader import self_contained

import ibrid
from ibrid import cli
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.schemas import schema

EXAMPLES = Path(__file__).resolve().parents[2] / "data" / "examples"


def few(monkeypatch: pytest.MonkeyPatch, **settings) -> None:
    """Fewer diagrams are fitted than for a user."""
    normal = replace(START_EFFORTS["normal"], **settings)
    monkeypatch.setattr("ibrid_search.starting.start.START_EFFORTS", {"normal": normal})


@pytest.fixture(scope="module")
def started(tmp_path_factory) -> Path:
    """The folder of a start on a device that ships, with 1 % noise."""
    folder = tmp_path_factory.mktemp("start")
    measured = ibrid.add_noise(
        ibrid.read_sweep(ibrid.benchmarks()["paper_like"]),
        noise_db=40,
        repeats=4,
        rng=np.random.default_rng(1),
    )
    write_sweep(measured, folder / "data.csv")
    assert cli.main(["start", str(folder / "data.csv"), "--out", str(folder / "out")]) == 0
    return folder


@pytest.mark.nightly
def test_the_shipped_diagram_that_made_the_data_is_first_and_graded(started):
    answer = json.loads((started / "out/start.json").read_text())
    assert [
        error.message for error in Draft202012Validator(schema("start")).iter_errors(answer)
    ] == []
    best, *others = answer["ranked"]
    assert (best["diagram"], best["grade"]) == ("gfl_pll_filter_exact", "explains")
    assert max(best["held_out"].values()) < 0.03  # the noise of one run is 1 %
    assert all(other["grade"] in ("rough", "fails", "close", "explains", None) for other in others)
    assert len(others) > 20
    assert answer["family"] == "grid-following, a PLL gives its angle"


@pytest.mark.slow
def test_what_was_looked_at_or_fails_stands_by_its_error(started):
    ranked = json.loads((started / "out/start.json").read_text())["ranked"]
    errors = [one["nrmse"] for one in ranked[1:] if one["grade"] in (None, "fails")]
    assert errors == sorted(errors)
    assert "phase margin" in (started / "out/report.html").read_text()  # the table of loops


@pytest.mark.nightly
def test_where_two_devices_alone_fit_the_sentence_and_the_search_say_so(
    tmp_path, monkeypatch, capsys
):
    few(monkeypatch, fitted=1)
    assert (
        cli.main(["start", "parallel_gfl_gfm", "--devices", "2", "--out", str(tmp_path / "out")])
        == 0
    )
    answer = json.loads((tmp_path / "out/start.json").read_text())
    assert [
        error.message for error in Draft202012Validator(schema("start")).iter_errors(answer)
    ] == []
    assert (answer["ranked"][0]["diagram"], answer["ranked"][0]["grade"]) == (
        "parallel_gfl_gfm",
        "explains",
    )
    assert "(two devices in parallel: grid-following" in answer["sentence"]
    (search,) = [line for line in answer["next"] if line.startswith("ibrid search")]
    assert "--devices 2" in search
    assert search in capsys.readouterr().out


@pytest.mark.parametrize("devices", [1, 2])
def test_where_no_diagram_fits_two_devices_are_suggested_once(devices, tmp_path):
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    failed = StartResult(
        sweep,
        ibrid.inspect(sweep),
        (DiagramFit("gfl", 0.5, "fails"),),
        "of no family",
        devices=devices,
    )
    again = [
        line
        for line in write_start(failed, "data.csv", tmp_path).next
        if line.startswith("ibrid start")
    ]
    assert again == (
        [f"ibrid start data.csv --devices 2 --out {tmp_path}_of_two"] if devices == 1 else []
    )


@pytest.mark.slow
def test_the_next_commands_can_be_pasted(started):
    answer = json.loads((started / "out/start.json").read_text())
    assert len(answer["next"]) == 3
    parser = cli.parser()
    for line in answer["next"]:
        program, *words = shlex.split(line)
        assert program == "ibrid"
        parser.parse_args(words)
    assert ibrid.read_record(started / "out/model.json").nrmse == pytest.approx(
        answer["ranked"][0]["nrmse"]
    )
    assert ibrid.read_program(started / "out/model.py").instances


@pytest.mark.slow
def test_the_page_begins_with_the_sentence_the_grade_and_the_diagram(started):
    answer = json.loads((started / "out/start.json").read_text())
    text = (started / "out/report.html").read_text()
    assert (
        text.index(answer["sentence"].split(":")[0])
        < text.index('id="diagram"')
        < text.index('id="next"')
    )
    self_contained(text)


@pytest.mark.slow
def test_what_was_only_screened_is_folded_on_the_page(started):
    answer = json.loads((started / "out/start.json").read_text())
    text = (started / "out/report.html").read_text()
    screened = [one for one in answer["ranked"] if not one["grade"]]
    assert f"<summary>{len(screened)} more, screened only</summary>" in text
    assert text.index("Fitted diagrams") < text.index("screened only</summary>")


@pytest.mark.slow
def test_the_first_screen_of_a_telephone_has_sentence_grade_and_diagram(started, tmp_path):
    page = (started / "out/report.html").read_text()
    question = """
    const wide = document.documentElement.scrollWidth, svg = document.querySelector("svg.diagram");
    const sections = [...document.querySelectorAll("main section")].map((one) => one.id);
    return [wide <= window.innerWidth, document.querySelector("header h1").textContent.trim(), sections[0],
            svg.getBoundingClientRect().width > 0, document.querySelectorAll(".zoombar").length];
    """
    ((narrow, title, first, drawn, bars),), console = asked([page], question, tmp_path)
    assert narrow
    assert title == "gfl_pll_filter_exact"
    assert (first, drawn, bars) == ("diagram", True, 1)
    assert not [line for line in console if "Error" in line or "Content Security" in line]


def test_a_foreign_table_that_says_everything_is_started_on_as_it_is(tmp_path, capsys):
    """And one that does not is refused with what to say."""
    truth = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    makes = {make.make: make for make in MAKES}
    (file,) = makes["tidy rows"].write(truth, tmp_path)
    assert cli.main(["start", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "--unit pu or --unit S" in capsys.readouterr().err


def test_records_whose_file_does_not_say_the_frequency_are_started_on_with_it(
    tmp_path, monkeypatch, capsys
):
    """Commands that go on have no option for it: they take the records as they were read."""
    fault, out = str(EXAMPLES / "fault.csv"), tmp_path / "out"
    given = []
    fit = SimpleNamespace(diagram="gfl", grade="explains", nrmse=0.01)

    def answered(data, **_):
        return SimpleNamespace(data=data, warnings=(), sentence="", ranked=(fit,), next=())

    def written(result, data, folder, options):
        given.append((result.data.f0_hz, data, options))
        return result

    monkeypatch.setattr("ibrid_search.starting.start.start", answered)
    monkeypatch.setattr("ibrid_search.starting.start_files.write_start", written)
    words = ["start", fault, "--base", "50kVA,690V", "--f0-hz", "60", "--out", str(out)]
    assert cli.main(words) == 0
    assert given == [(60.0, str(out / "events.csv"), [])]
    assert ibrid.read_events(out / "events.csv").f0_hz == 60.0
    capsys.readouterr()
    assert cli.main(["start", "paper_like", "--f0-hz", "60", "--out", str(tmp_path / "no")]) == 2
    assert "ibrid import paper_like --f0-hz 60" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


@pytest.fixture(scope="module")
def with_records(started) -> Path:
    """The folder of a start on the same sweep with records of a dip and a jump of the angle beside
    it, 1 % noise.
    """
    options = ["--op", "p=1,q=0.3", "--event", "dip:0.7", "--event", "phase:10", "--noise-db", "40"]
    assert (
        cli.main(
            ["record", "paper_like", *options, "--length", "0.3", "--out", str(started / "dip.csv")]
        )
        == 0
    )
    words = [
        str(started / "data.csv"),
        "--events",
        str(started / "dip.csv"),
        "--out",
        str(started / "both"),
    ]
    assert cli.main(["start", *words]) == 0
    return started / "both"


@pytest.mark.nightly
def test_records_beside_the_sweep_are_fitted_with_it_and_their_errors_said(with_records):
    answer = json.loads((with_records / "start.json").read_text())
    assert [
        error.message for error in Draft202012Validator(schema("start")).iter_errors(answer)
    ] == []
    best = answer["ranked"][0]
    assert (best["diagram"], best["grade"]) == ("gfl_pll_filter_exact", "explains")
    assert set(best["nrmse_by_record"]) == {"dip:0.7", "phase:10"}
    assert (
        max(best["nrmse_by_record"].values()) < 0.02
    )  # noise of each component is 1 % of the rms of both
    assert "Error of the recordings, fitted together with the sweep" in answer["sentence"]
    parser = cli.parser()
    beside = [line for line in answer["next"] if " gap " in line or " search " in line]
    assert beside
    assert all(
        parser.parse_args(shlex.split(line)[1:]).events.endswith("dip.csv") for line in beside
    )
    assert "Records of events" in (with_records / "report.html").read_text()


@pytest.mark.nightly
def test_records_alone_have_a_first_answer_that_predicts_one_of_them(tmp_path, monkeypatch, capsys):
    few(monkeypatch, fitted=1)
    file, folder = tmp_path / "dips.csv", tmp_path / "out"
    options = [
        "--op",
        "p=0.8,q=-0.2",
        "--event",
        "dip:0.8,at=0.04,for=0.04",
        "--event",
        "phase:8,at=0.04",
    ]
    options += [
        "--event",
        "dip:0.9,at=0.04,for=0.04",
        "--rate",
        "2500",
        "--length",
        "0.12",
        "--noise-db",
        "50",
    ]
    assert cli.main(["record", "gfl_l_filter", *options, "--out", str(file)]) == 0
    assert cli.main(["start", str(file), "--out", str(folder)]) == 0
    answer = json.loads((folder / "start.json").read_text())
    assert [
        error.message for error in Draft202012Validator(schema("start")).iter_errors(answer)
    ] == []
    best = answer["ranked"][0]
    assert (best["diagram"], best["grade"]) == ("gfl_l_filter", "explains")
    assert set(best["nrmse_by_record"]) == {"dip:0.8", "phase:8", "dip:0.9"}
    assert best["held_out"]["dip:0.9"] < 1.2 * 10**-2.5  # the noise
    assert "Error at a held-out event" in answer["sentence"]
    assert "Records of events" in (folder / "report.html").read_text()
    capsys.readouterr()
    for line in answer["next"]:
        words = shlex.split(line)[1:]
        assert words[0] == "gap" or cli.main(words) == 0, line
    assert cli.main(["start", str(file), "--events", str(file), "--out", str(folder)]) == 2
    assert "give a sweep as DATA or leave one out" in capsys.readouterr().err


@pytest.mark.nightly
def test_where_a_limit_bends_records_a_mild_one_alone_is_explained_and_the_gap_goes_on_from_it(
    tmp_path, monkeypatch
):
    few(monkeypatch, fitted_to_events=1)
    case = draw("current_limit", 5, 60.0, swept=False)
    answer = write_start(
        start(case.events, tell=lambda words, share: None), "records.csv", tmp_path
    )
    assert answer.single_event == case.events.names[1]
    # the filter before the PLL hardly shows in one small event
    assert ibrid.textbook(answer.best.diagram) in (ibrid.textbook("gfl"), case.diagram)
    assert answer.best.grade == "explains"
    assert answer.best.held_out is not None
    assert set(answer.best.held_out) == {case.events.names[0], case.events.names[2]}
    assert min(answer.best.held_out.values()) > 0.1
    assert answer.sentence.startswith(
        f"For the mild event {case.events.names[1]} alone, the shipped diagram"
    )
    assert answer.next[0].startswith(f"ibrid gap {tmp_path / 'model.json'} records.csv")
    page = (tmp_path / "report.html").read_text()
    assert f"NRMSE, {case.events.names[1]}" in page
    assert all(f"held out: {name}" in page for name in answer.best.held_out)


@pytest.mark.nightly
def test_a_report_reads_the_records_again_that_a_model_was_fitted_to(with_records, capsys):
    assert (
        cli.main(
            ["report", str(with_records / "model.json"), "--out", str(with_records / "page.html")]
        )
        == 0
    )
    assert capsys.readouterr().err == ""
    text = (with_records / "page.html").read_text()
    assert "Records of events" in text
    assert "phase:10" in text
    events = with_records.parent / "dip.csv"
    moved = events.rename(events.with_name("moved.csv"))
    try:
        assert cli.main(["report", str(with_records / "model.json")]) == 0
        assert "Records of events are not shown" in capsys.readouterr().err
        assert cli.main(["report", str(with_records / "model.json"), "--events", str(moved)]) == 0
        assert capsys.readouterr().err == ""
    finally:
        moved.rename(events)


@pytest.mark.nightly
def test_options_of_records_without_records_are_refused(with_records, capsys):
    assert cli.main(["start", str(with_records.parent / "data.csv"), "--base", "1MVA,1kV"]) == 2
    assert "--channels and --base are of records of events" in capsys.readouterr().err


def test_a_page_without_any_fit_says_what_is_odd_about_the_data(tmp_path):
    """Of a scan of the positive sequence alone, whose note the sweep file carries; no time was left
    for a fit.
    """
    sweep = replace(
        ibrid.read_sweep(ibrid.benchmarks()["paper_like"]), notes=("matrix: positive sequence",)
    )
    answer = StartResult(
        sweep, ibrid.inspect(sweep), (DiagramFit("gfl", 0.5, "fails"),), "of no family"
    )
    written = write_start(answer, "data.csv", tmp_path)
    assert "positive sequence alone was measured" in written.warnings[0]
    page = (tmp_path / "report.html").read_text()
    assert "positive sequence alone was measured" in page
    assert 'id="response"' in page  # the data are drawn all the same
    assert "Bode plot of Y_dd" in page
    assert (
        json.loads((tmp_path / "start.json").read_text())["data"]["warnings"][0]
        == written.warnings[0]
    )
