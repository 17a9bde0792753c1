"""The page and the text of a record: complete, self-contained, safe with hostile names, and drawn
without overlaps.
"""

import dataclasses
import re
import shutil
import subprocess
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from page_reader import Reader, self_contained

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record, read_record
from ibrid.measurement.formats.csv_file import read_csv
from ibrid.measurement.hardware import hardware_sweeps
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.benchmarks import benchmarks
from ibrid.report.block_diagrams.block_diagram import LARGEST, block_diagram_svg
from ibrid.report.block_diagrams.block_graph import block_graph
from ibrid.report.block_diagrams.drawing import Layout, arrange
from ibrid.report.facts.modes import modes
from ibrid.report.facts.parameter_rows import parameter_rows
from ibrid.report.facts.verdict import stability, verdict
from ibrid.report.look.numbers import error, interval, more_readable, number
from ibrid.report.pages.page import report_html, write_report
from ibrid.report.texts.text import format_record
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook, textbook_names
from ibrid.structure.diagrams.program import parse_program

HOSTILE = '<script>alert("x")</script>&'


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    return read_csv(benchmarks()["paper_like"])


@pytest.fixture(scope="module")
def record(sweep: Sweep) -> Record:
    return evaluate(textbook("gfl_exact"), sweep)


@pytest.fixture(scope="module")
def page(record: Record, sweep: Sweep) -> str:
    return report_html(record, sweep=sweep)


@pytest.fixture(scope="module")
def paper_record(sweep: Sweep) -> Record:
    return evaluate(
        textbook("gfl_pll_filter"),
        sweep,
        parameters="per-op",
        equilibrium="paper",
        vocabulary="paper",
        restarts=0,
    )


@pytest.mark.slow
def test_page_is_well_formed_and_loads_nothing_from_elsewhere(page):
    self_contained(page)


@pytest.mark.slow
def test_page_shows_all_entries_and_operating_points(page, record):
    for entry in ("dd", "dq", "qd", "qq"):
        assert f'aria-label="Bode plot of Y_{entry}' in page
    for op in record.parameters:
        assert page.count(op) > 5


@pytest.mark.slow
def test_every_number_of_the_record_stands_in_the_page_with_all_its_digits(page, record):
    shown = {float(one["value"] or "nan") for one in Reader(page).all("data")}
    wanted = {
        record.nrmse,
        *record.nrmse_by_op.values(),
        *record.nrmse_by_band.values(),
        *record.nrmse_by_entry.values(),
    }
    wanted |= {value for values in record.parameters.values() for value in values.values()}
    wanted |= {
        value
        for bands in record.nrmse_by_part.values()
        for found in bands.values()
        for value in found.values()
    }
    assert wanted <= shown


@pytest.mark.slow
def test_figures_tables_and_sections_can_be_read_without_seeing(page):
    reader = Reader(page)
    pictures = [one for one in reader.all("svg") if one.get("aria-hidden") != "true"]
    assert len(pictures) == 10  # a diagram, poles, and four entries each of Y and Z
    assert all(one.get("role") == "img" and one.get("aria-label") for one in pictures)
    assert all(one.get("scope") in ("row", "col", "rowgroup") for one in reader.all("th"))
    assert all(
        one.get("tabindex") == "0" and one.get("aria-label")
        for one in reader.all("div")
        if one.get("class") == "scroll"
    )
    assert len(reader.all("h1")) == 1
    assert {"header", "nav", "main", "footer"} <= {tag for tag, _ in reader.tags}


@pytest.mark.slow
def test_page_follows_the_colours_of_the_reader(page):
    assert "prefers-color-scheme:dark" in page
    assert "@media print" in page
    stand_ins = re.findall(r"#0[1-6]0[0-9][0-9a-f]{2}\b", page.split("</style>")[1])
    assert not stand_ins
    assert "stroke: var(--series-0)" in page


@pytest.mark.slow
def test_measured_dots_come_from_the_file_of_the_record_when_no_sweep_is_given(record):
    assert "Dots: measured" in report_html(record)


@pytest.mark.slow
def test_page_without_data_shows_model_lines_and_says_so(record, tmp_path):
    lost = dataclasses.replace(
        record, settings={**record.settings, "data": str(tmp_path / "gone.csv")}
    )
    text = report_html(lost)
    assert "Only model lines are shown" in text
    assert "Lines: model." in text
    assert "Dots: measured" not in text


@pytest.mark.slow
def test_page_says_when_the_data_are_no_longer_those_of_the_record(record, sweep):
    other = add_noise(sweep, 30.0, rng=np.random.default_rng(1))
    assert "not those that were fitted" in report_html(record, sweep=other)
    assert "not those that were fitted" not in report_html(record, sweep=sweep)


@pytest.mark.slow
def test_noise_that_is_known_gives_error_bars(sweep):
    noisy = add_noise(sweep, 40.0, rng=np.random.default_rng(0))
    assert noisy.points[0].sigma is not None
    text = report_html(evaluate(textbook("gfl_exact"), noisy, restarts=0), sweep=noisy)
    assert "Bars: two standard deviations" in text
    assert "LineCollection" in text


@pytest.mark.slow
def test_an_error_that_is_noise_is_called_noise(sweep):
    noisy = add_noise(sweep, 40.0, rng=np.random.default_rng(0))
    right = evaluate(textbook("gfl_pll_filter_exact"), noisy, restarts=0)
    assert "explains the measurement down to its noise" in verdict(right)
    assert "down to its noise" in format_record(right)
    wrong = evaluate(textbook("naive"), noisy, restarts=0)
    assert "noise 0.0100" in verdict(wrong)  # 40 dB


@pytest.mark.slow
def test_hostile_names_are_shown_and_never_become_markup(record):
    op, other = record.parameters
    renamed = _renamed(record, {op: HOSTILE})
    renamed = dataclasses.replace(
        renamed, warnings=(HOSTILE,), reasons=(), identifiability=(HOSTILE,)
    )
    text = report_html(renamed, title=HOSTILE)
    self_contained(text)
    assert HOSTILE not in text
    assert "".join(Reader(text).words).count(HOSTILE) > 8
    assert other in text


def _renamed(record: Record, names: dict[str, str]) -> Record:
    def swap(mapping):
        return {names.get(key, key): value for key, value in mapping.items()}

    fields = ("nrmse_by_op", "nrmse_by_part", "parameters", "intervals", "stable", "poles")
    points = swap(record.settings["operating_points"])
    return dataclasses.replace(
        record,
        settings={**record.settings, "operating_points": points, "data": ""},
        **{name: swap(getattr(record, name)) for name in fields},
    )


@pytest.mark.slow
def test_record_read_back_from_its_file_gives_the_same_page(record, sweep, tmp_path):
    record.write(tmp_path / "record.json")
    assert report_html(read_record(tmp_path / "record.json"), sweep=sweep) == report_html(
        record, sweep=sweep
    )


def test_invalid_record_gives_reasons_program_and_diagram(sweep):
    diagram = textbook("naive")
    diagram.add("Gain_dq", "dangling")
    invalid = evaluate(diagram, sweep)
    assert invalid.outcome == "invalid"
    text = report_html(invalid)
    self_contained(text)
    words = "".join(Reader(text).words)
    assert all(reason in words for reason in invalid.reasons)
    assert "The grammar refuses the program" in words
    assert 'class="diagram' in text
    assert invalid.program in words


@pytest.mark.parametrize("outcome", ["invalid", "failed", "unfinished"])
def test_record_whose_program_cannot_be_read_gives_a_page_too(outcome):
    broken = Record(
        outcome=outcome, reasons=("the program has no first line",), program="import <os>"
    )
    text = report_html(broken)
    self_contained(text)
    assert "there is no diagram to draw" in text
    assert "import &lt;os&gt;" in text
    assert outcome in format_record(broken)


def test_unknown_kinds_and_half_wired_modules_are_drawn():
    program = """
def build(g):
    g.add("Flux_capacitor", "doc")
    g.add("LCL", "plant")
    g.connect("doc.out", "plant.u_r")
    g.connect("ghost.out", "plant.u_r")
    g.connect("plant.i_g", "doc.in_")
    g.connect("doc.out", "doc.self")
"""
    svg = block_diagram_svg(parse_program(program), VOCABULARY)
    assert "family-unknown" in svg
    assert all(name in svg for name in ("doc", "plant", "ghost"))


def test_enormous_and_empty_diagrams_are_not_drawn():
    large = Diagram()
    for index in range(LARGEST + 1):
        large.add("Gain", f"gain_{index}")
    assert "drawings are made of at most" in block_diagram_svg(large, VOCABULARY)
    assert "nothing to draw" in block_diagram_svg(Diagram(), VOCABULARY)


@pytest.fixture(scope="module", params=textbook_names())
def drawing(request) -> Layout:
    return arrange(block_graph(textbook(request.param), VOCABULARY))


@pytest.mark.nightly
def test_boxes_of_a_diagram_do_not_overlap_and_stay_inside(drawing):
    boxes = drawing.boxes
    for left, top, width, height in boxes.values():
        assert left >= 0
        assert top >= 0
        assert left + width <= drawing.width
        assert top + height <= drawing.height
    for one, two in combinations(boxes.values(), 2):
        apart = one[0] + one[2] <= two[0] or two[0] + two[2] <= one[0]
        assert apart or one[1] + one[3] <= two[1] or two[1] + two[3] <= one[1]


@pytest.mark.slow
def test_labels_fit_into_their_boxes(drawing):
    for node in drawing.placement.graph.nodes:
        if node.shape == "module":  # about 7 units a character of 12 units height
            assert drawing.boxes[node.name][2] >= 7 * len(node.name)


@pytest.mark.slow
def test_lines_pass_no_box(drawing):
    nets = drawing.placement.graph.nets
    circles = {
        drawing.boxes[node.name][2:]
        for node in drawing.placement.graph.nodes
        if node.shape == "sum"
    }
    for index in range(len(nets)):
        for (x1, y1), (x2, y2) in drawing.pieces(index):
            assert x1 == x2 or y1 == y2
            for left, top, width, height in drawing.boxes.values():
                inside_x = min(max(x1, x2), left + width) - max(min(x1, x2), left)
                inside_y = min(max(y1, y2), top + height) - max(min(y1, y2), top)
                # a line may end on the rim of a circle, which lies inside its square
                allowed = 0.0 if (width, height) not in circles else height / 2
                assert min(inside_x, inside_y) < 0 or max(inside_x, inside_y) <= allowed + 0.1


@pytest.mark.slow
def test_lines_of_different_nets_cross_but_never_run_on_top_of_each_other(drawing):
    nets = range(len(drawing.placement.graph.nets))
    for one, two in combinations(nets, 2):
        for a in drawing.pieces(one):
            for b in drawing.pieces(two):
                assert not _shared(a, b), (one, two, a, b)


def _shared(a, b) -> bool:
    for axis in (0, 1):
        across = 1 - axis
        if (
            a[0][across] == a[1][across]
            and b[0][across] == b[1][across]
            and abs(a[0][across] - b[0][across]) < 1.0
        ):
            low = max(min(a[0][axis], a[1][axis]), min(b[0][axis], b[1][axis]))
            high = min(max(a[0][axis], a[1][axis]), max(b[0][axis], b[1][axis]))
            if high - low > 0.5:
                return True
    return False


@pytest.mark.slow
def test_every_connection_is_drawn_from_its_source_to_its_target(drawing):
    graph = drawing.placement.graph
    for index, net in enumerate(graph.nets):
        reached = _reachable(drawing.pieces(index), drawing.end(net.source, "outputs"))
        assert all(reached(drawing.end(pin, "inputs")) for pin in net.targets)


def _reachable(pieces, start):
    """Whether a point hangs together with `start` through pieces that touch."""
    found, rest = [(start, start)], list(pieces)
    while touching := [piece for piece in rest if any(_touch(piece, other) for other in found)]:
        found += touching
        rest = [piece for piece in rest if piece not in touching]
    return lambda point: any(_touch((point, point), piece) for piece in found)


def _touch(a, b) -> bool:
    return all(
        max(min(a[0][k], a[1][k]), min(b[0][k], b[1][k]))
        <= min(max(a[0][k], a[1][k]), max(b[0][k], b[1][k])) + 0.01
        for k in (0, 1)
    )


def test_loops_that_avoid_the_plant_are_drawn_too():
    diagram = Diagram()
    for name in ("a", "b", "c"):
        diagram.add("Gain", name)
        diagram.connect(f"{name}.out", f"{name}.in_")
    diagram.connect("a.out", "b.in_")
    diagram.connect("b.out", "c.in_")
    diagram.connect("c.out", "a.in_")
    found = arrange(block_graph(diagram, VOCABULARY))
    assert set(found.boxes) == {"a", "b", "c", "sum at a.in_", "sum at b.in_", "sum at c.in_"}


@pytest.mark.slow
def test_text_is_narrow_and_holds_outcome_errors_parameters_and_sentences(record):
    text = format_record(record)
    assert max(map(len, text.splitlines())) <= 110
    assert text.startswith(f"{record.grade}: ")
    for name, value in next(iter(record.parameters.values())).items():
        assert re.search(rf"^{re.escape(name)} +{re.escape(number(value))} ", text, re.MULTILINE)
    for op, value in record.nrmse_by_op.items():
        assert f"{op}" in text
        assert error(value) in text
    flat = re.sub(r"\s+", " ", text)
    assert all(sentence in flat for sentence in record.identifiability)


@pytest.mark.slow
def test_one_of_something_is_in_the_singular(record):
    assert (
        f"{record.modules} modules, 1 sum, order {record.order}, 1 free parameter\n"
        in format_record(dataclasses.replace(record, sums=1, free_parameters=1))
    )


@pytest.mark.slow
def test_text_names_the_operating_point_of_every_value_that_is_not_shared(paper_record):
    text = format_record(paper_record)
    assert max(map(len, text.splitlines())) <= 110
    for op in paper_record.parameters:
        assert re.search(rf"^plant\.C_F .* {re.escape(op)}$", text, re.MULTILINE)


@pytest.mark.slow
def test_text_and_page_of_a_held_out_point_say_that_it_was_predicted(sweep):
    held = evaluate(textbook("gfl_pll_filter_exact"), sweep, holdout_op=sweep.names[1], restarts=0)
    assert "held out: predicted, not fitted" in format_record(held)
    assert "held out: predicted, not fitted" in report_html(held, sweep=sweep)
    assert sweep.names[1] in verdict(held)


@pytest.mark.slow
def test_a_value_at_its_bound_is_flagged(record):
    bound = dataclasses.replace(record, at_bound=("plant.C_F",))
    assert [row.name for row in parameter_rows(bound) if row.at_bound] == ["plant.C_F"]
    assert "at bound" in report_html(bound)
    assert "AT BOUND of 1e-5 to 1" in format_record(bound)


@pytest.mark.slow
def test_an_unstable_point_is_named(record):
    first = next(iter(record.poles))
    unstable = dataclasses.replace(
        record,
        stable={**record.stable, first: False},
        poles={**record.poles, first: [[3.0, -40.0], [3.0, 40.0]]},
    )
    assert stability(unstable) == f"unstable at {first}"
    assert "UNSTABLE" in format_record(unstable)
    assert "UNSTABLE" in report_html(unstable)


def test_modes_are_those_of_a_second_order_system():
    # s^2 + 2 zeta omega s + omega^2 with zeta = 0.1 at 50 Hz
    omega, zeta = 2 * np.pi * 50, 0.1
    poles = [[-zeta * omega, sign * omega * np.sqrt(1 - zeta**2)] for sign in (-1, 1)]
    (found,) = modes([*poles, [-5.0, 0.0]])
    assert found.frequency == pytest.approx(
        50 * np.sqrt(1 - zeta**2)
    )  # of the oscillation that one sees
    assert found.damping == pytest.approx(0.1)


@each_of(
    ("value", "text"),
    [
        (0.0721265, "0.07213"),
        (1400.0, "1400"),
        (23961.5, "23960"),
        (1.1518e-5, "1.152e-5"),
        (0.0, "0"),
        (-0.5, "-0.5"),
        (9999.6, "10000"),
        (3.2e7, "3.2e7"),
        (None, "-"),
    ],
)
def test_numbers_are_written_as_an_engineer_writes_them(value, text):
    assert number(value) == text


def test_cutoffs_delays_and_angles_are_also_given_in_the_unit_one_thinks_in():
    assert more_readable(2 * np.pi * 500, "rad/s") == "500 Hz"
    assert more_readable(1.5e-4, "s") == "150 us"
    assert more_readable(np.pi / 4, "rad") == "45 deg"
    assert more_readable(0.15, "pu") == ""


def test_intervals_are_read_as_words():
    assert interval(2.0, None, (0, 10)) == "not visible"
    assert interval(2.0, (1.98, 2.02), (0, 10)) == "+- 1 %"
    assert interval(2.0, (1.0, 4.0), (0, 10)) == "1 to 4"
    assert interval(2.0, (0.0, 10.0), (0, 10)) == "the whole box"


@pytest.mark.slow
def test_importing_the_package_and_its_reports_loads_no_plotting_library():
    code = (
        "import sys, ibrid, ibrid.report, ibrid.report.texts.text; "
        "assert not {'matplotlib', 'jinja2', 'rich'} & {*sys.modules}"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=600)


@pytest.mark.slow
def test_page_is_replaced_as_a_whole_and_leaves_nothing_beside_it(record, sweep, tmp_path):
    target = tmp_path / "report.html"
    target.write_text("old")
    assert write_report(record, target, sweep=sweep) == target
    assert target.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.slow
def test_page_that_cannot_be_written_is_one_clear_sentence(record, sweep, tmp_path):
    with pytest.raises(IbridError, match="there is no folder"):
        write_report(record, tmp_path / "no" / "such" / "report.html", sweep=sweep)


def test_hardware_record_has_a_page(tmp_path):
    found = hardware_sweeps()
    if "gti_pq" not in found:
        pytest.skip(
            "the hardware sweeps are not on this machine (data/README.md says where to get them)"
        )
    measured = evaluate(textbook("gfl_l_filter_delay"), read_csv(found["gti_pq"]), restarts=0)
    text = write_report(measured, tmp_path / "hardware.html").read_text(encoding="utf-8")
    self_contained(text)
    assert "Padé" in text


@pytest.mark.nightly
@pytest.mark.parametrize("width", [1200, 500])
def test_headless_browser_renders_the_page(page, tmp_path, width):
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
    subprocess.run(
        [
            browser,
            *options,
            f"--screenshot={picture}",
            f"--window-size={width},2000",
            (tmp_path / "page.html").as_uri(),
        ],
        check=True,
        timeout=600,
        capture_output=True,
    )
    assert _colours(picture) > 50  # a blank page has one


def _colours(picture: Path) -> int:
    from matplotlib.image import imread

    pixels = imread(picture)[::2, ::2, :3]
    return len(np.unique(np.round(255 * pixels).astype(int).reshape(-1, 3), axis=0))


@pytest.mark.slow
def test_a_text_tells_the_loops_and_a_real_pole_as_such():
    record = evaluate(
        textbook("gfl_l_filter"), read_csv(benchmarks()["published_touti_19kva"]), restarts=0
    )
    told = format_record(record)
    assert re.search(r"PLL +pll +66.5 Hz +62.8 deg +66 %", told)
    assert re.findall(r"(\S+) Hz at 100 %", told) == []
    slowest = max(real for real, imaginary in record.poles["p=1,q=0.3"] if abs(imaginary) < 1e-3)
    assert f"slowest real pole {slowest:.3g} 1/s" in told
    assert [
        one.frequency for one in modes([[-20.0, 6e-11], [-20.0, -6e-11], [-1.0, 2.0], [-1.0, -2.0]])
    ] == [pytest.approx(2.0 / (2 * np.pi))]
