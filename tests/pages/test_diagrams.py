"""Diagrams as engineers draw them: minus at the sum, values in blocks, loops framed and named,
zoom, bandwidth, damping.
"""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from browser import asked
from fitted import benchmark, evaluated, measured

import ibrid
from ibrid.analysis.models.loop_modes import loop_modes
from ibrid.assembly.numbers import Scalar
from ibrid.assembly.rest import rest
from ibrid.assembly.set_points import SET_POINTS, is_zero, set_point_gains
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.block_diagrams.block_diagram import Shown, block_diagram_svg, drawn_diagrams
from ibrid.report.block_diagrams.block_graph import block_graph
from ibrid.report.block_diagrams.drawing import arrange
from ibrid.report.block_diagrams.loop_frames import Frame, _belongs, _meet, loop_frames
from ibrid.report.block_diagrams.references import PORT, REFERENCE, with_references
from ibrid.report.facts.parameter_rows import parameter_rows, values_of
from ibrid.report.look.numbers import in_si
from ibrid.report.look.style import style_sheet
from ibrid.report.pages.page import report_html
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import shipped_names, textbook
from ibrid.structure.editing.loops import loops
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire


def test_a_sign_in_front_of_a_sum_is_its_minus():
    graph = block_graph(textbook("gfl_pll_filter_exact"), VOCABULARY)
    names = [node.name for node in graph.nodes]
    assert "minus_i" not in names
    (error,) = [node for node in graph.nodes if node.name == "sum at current.in_"]
    (port,) = error.minus
    (net,) = [net for net in graph.nets if ("sum at current.in_", port) in net.targets]
    assert net.source == ("plant", "i_ti")
    # a controlled quantity alone at a regulator is a sum with the reference that a linear model has
    # lost
    (power,) = [node for node in graph.nodes if node.name == "sum at p_loop.in_"]
    assert power.minus == power.inputs == ("0",)
    drawn = with_references(graph, VOCABULARY)
    (power,) = [node for node in drawn.nodes if node.name == "sum at p_loop.in_"]
    assert (power.inputs, power.minus) == ((PORT, "0"), ("0",))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("gfl_pll_filter_exact", {"p_loop.in_": "p_ref", "q_loop.in_": "q_ref"}),
        ("gfm_droop", {"p_droop.in_": "p_ref", "q_droop.in_": "q_ref"}),
        ("gfl_dc_link", {"dc_loop.in_": "v_dc_ref", "ac_loop.in_": "v_ref"}),
        ("gfl_type1_pll", {"current.in_": "i_ref"}),
        ("naive", {}),
    ],
)
def test_references_stand_where_the_outer_controllers_compare(name: str, expected: dict[str, str]):
    drawn = with_references(block_graph(textbook(name), VOCABULARY), VOCABULARY)
    references = [node for node in drawn.nodes if node.shape == "reference"]
    assert {node.name.removeprefix(REFERENCE): node.kind for node in references} == expected
    for node in references:
        (net,) = [net for net in drawn.nets if net.source[0] == node.name]
        ((junction, port),) = net.targets
        there = drawn.node(junction)
        others = [one for one in there.inputs if one != port]
        assert there.shape == "sum"
        assert others
        # of the other sign than what it is compared with
        assert (port in there.minus) != (others[0] in there.minus)


def moved_by_set_points(diagram: Diagram) -> tuple[set[str], set[str]]:
    """Inputs whose constants move with a set point of power in the nonlinear model, and which set
    points those are.
    """
    wiring = wire(diagram, VOCABULARY)
    symbols = {
        name: Scalar(ca.SX.sym(name))
        for name in (*parameter_table(wiring, "exact").names, "p", "q", "v")
    }
    at = rest(
        wiring,
        parameter_table(wiring, "exact"),
        symbols,
        (symbols["p"], symbols["q"], symbols["v"]),
        power_node="pcc",
        omega_0=100 * np.pi,
        pade_orders={name: 2 for name, kind in wiring.kinds.items() if kind.delay},
    )
    arguments = {module.name: module.arguments for module in at.modules}
    gains = set_point_gains(wiring, at.modules, at.references, arguments)
    taken = {
        name
        for pair in gains.values()
        for name, gain in zip(SET_POINTS, pair, strict=True)
        if not is_zero(gain)
    }
    return {channel[0] for channel in gains}, taken


def test_a_power_that_is_told_is_a_reference_in_the_drawing():
    """Two ways to the same: what a step of a set point moves when it is played, and what is
    drawn.
    """
    places = 0
    for name in shipped_names():
        diagram = textbook(name)
        moved, taken = moved_by_set_points(diagram)
        drawn = with_references(block_graph(diagram, VOCABULARY), VOCABULARY)
        shown = {
            node.name.removeprefix(REFERENCE): node.kind.split(", ")
            for node in drawn.nodes
            if node.shape == "reference" and {*node.kind.split(", ")} <= {*SET_POINTS}
        }
        assert {one for told in shown.values() for one in told} == taken, name
        kinds = {one.name: one.kind for one in diagram.instances}
        if all(kinds[place.split(".")[0]] == "PI" for place in shown):
            assert set(shown) == moved, name  # of a droop the constant lies behind its gain
            places += len(shown)
    assert places > 30


def test_every_sum_has_a_sign_at_each_input():
    for name in shipped_names():
        diagram = textbook(name)
        graph = with_references(block_graph(diagram, VOCABULARY), VOCABULARY)
        inputs = sum(len(node.inputs) for node in graph.nodes if node.shape == "sum")
        svg = block_diagram_svg(diagram, VOCABULARY)
        assert svg.count('class="sign"') == inputs, name


def test_a_sign_that_is_framed_or_meets_another_stays_a_block():
    diagram = textbook("gfl_pll_filter_exact")
    assert "minus_i" in [
        node.name for node in block_graph(diagram, VOCABULARY, kept=("minus_i",)).nodes
    ]
    twice = Diagram()
    twice.add("Negate", "one")
    twice.add("Negate", "two")
    twice.add("Gain", "gain")
    for source, target in (
        ("gain.out", "one.in_"),
        ("one.out", "two.in_"),
        ("two.out", "gain.in_"),
    ):
        twice.connect(source, target)
    assert {node.name for node in block_graph(twice, VOCABULARY).nodes} == {"one", "two", "gain"}


@pytest.mark.slow
def test_blocks_bear_their_values_and_have_room_for_them():
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    lines = values_of(record)
    assert lines["pll"] == ["kP_pll 60, kI_pll 1400"]
    svg = block_diagram_svg(record.diagram, record.vocabulary, values=lines)
    assert svg.count('class="value"') == sum(map(len, lines.values()))
    drawing = arrange(block_graph(record.diagram, record.vocabulary, lines))
    for one, two in combinations(drawing.boxes.values(), 2):
        apart = one[0] + one[2] <= two[0] or two[0] + two[2] <= one[0]
        assert apart or one[1] + one[3] <= two[1] or two[1] + two[3] <= one[1]


@pytest.mark.slow
def test_values_that_the_data_do_not_tell_and_values_at_a_bound_are_marked():
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    op = next(iter(record.parameters))
    unseen = [name for name, ends in record.intervals[op].items() if ends is None]
    assert {"current.kP", "decoupling.L"} <= set(unseen)
    marked = replace(record, at_bound=("pll.kP_pll", f"plant.R_g at {op}"))
    lines = " ".join(line for lines in values_of(marked).values() for line in lines)
    assert lines.count("?") == len(unseen)
    assert "kP_pll 60!" in lines
    assert "R_g 0.01!" in lines
    drawn = drawn_diagrams([Shown("", record.diagram, values=values_of(marked))], VOCABULARY)
    ((_, svg, _),) = drawn.figures
    assert svg.count('<tspan class="mark">?') == len(unseen)
    assert [mark for mark, _ in drawn.marks] == ["?", "!"]
    assert drawn_diagrams([Shown("", record.diagram)], VOCABULARY).marks == []


#: Words of a diagram that a wire crosses, that meet other words, or that leave the picture.
CROSSED = """
  const bad = [];
  const meet = (a, b) => b.x < a.x + a.width - 1 && a.x < b.x + b.width - 1 && b.y < a.y + a.height - 3 && a.y < b.y + b.height - 3;
  for (const svg of document.querySelectorAll("svg.diagram")) {
    const lines = [...svg.querySelectorAll(".net path:not(.tip)")].flatMap((one) => [...one.getAttribute("d").matchAll(/M([-\\d.]+) ([-\\d.]+)L([-\\d.]+) ([-\\d.]+)/g)].map((found) => found.slice(1).map(Number)));
    const wires = lines.map(([a, b, c, d]) => ({ x: Math.min(a, c), y: Math.min(b, d), width: Math.abs(c - a) + 2, height: Math.abs(d - b) + 4 }));
    const words = [...svg.querySelectorAll("text:not(.sign)")].map((one) => [one.textContent, one.getBBox()]), room = svg.viewBox.baseVal;
    words.forEach(([text, box], k) => {
      if (wires.some((one) => meet(box, { ...one, x: one.x - 1, y: one.y - 2 }))) bad.push([svg.parentElement.id, "wire", text]);
      if (words.some(([, other], j) => j !== k && meet(box, other))) bad.push([svg.parentElement.id, "words", text]);
      if (box.x < 0 || box.y < 0 || box.x + box.width > room.width || box.y + box.height > room.height) bad.push([svg.parentElement.id, "cut", text]);
    });
  }
  return [document.querySelectorAll("svg.diagram text").length, bad];
"""


@pytest.mark.slow
def test_no_wire_runs_through_words_in_any_shipped_diagram(tmp_path: Path):
    drawn = "".join(
        f'<div id="{name}">{block_diagram_svg(textbook(name), VOCABULARY)}</div>'
        for name in shipped_names()
    )
    page = f"<!DOCTYPE html><style>{style_sheet()}</style>{drawn}"
    ((number, bad),), _ = asked([page], CROSSED, tmp_path)
    assert number > 1000
    assert bad == []
    crossed = page.replace('<g class="loop"><text x="', '<g class="loop"><text x="-', 1)
    ((_, found),), _ = asked([crossed], CROSSED, tmp_path)
    assert found  # words that are cut off are found out


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("gfl_pll_filter_exact", {"PLL": "pll", "current": "current", "power": "p_loop"}),
        (
            "gfm_droop",
            {
                "frequency": "p_droop",
                "voltage": "voltage",
                "current": "current",
                "power": "q_droop",
            },
        ),
        ("gfl_dc_link", {"PLL": "pll", "current": "current", "power": "dc_loop"}),
        (
            "parallel_gfl_gfm",
            {"PLL 1": "gfl_pll", "current 1": "gfl_current", "power 1": "gfl_p_loop"}
            | {"frequency 2": "gfm_p_droop", "voltage 2": "gfm_voltage", "power 2": "gfm_q_droop"}
            | {"current 2": "gfm_current"},
        ),
    ],
)
def test_loops_are_known_by_what_regulates_in_them_each_device_by_its_own(
    name: str, expected: dict[str, str]
):
    found = loops(textbook(name), VOCABULARY)
    assert {title: members[0] for title, members in found.items()} == expected


def holds(frame: Frame, box: tuple[float, float, float, float]) -> bool:
    x, y, width, height = box
    return any(
        left <= x and right >= x + width and top <= y and bottom >= y + height
        for left, top, right, bottom in frame.boxes
    )


@pytest.mark.nightly
def test_frames_hold_their_loop_with_its_sums_and_no_other_block_and_do_not_overlap():
    outside = []
    for name in shipped_names():
        diagram = textbook(name)
        drawing = arrange(block_graph(diagram, VOCABULARY))
        found = loops(diagram, VOCABULARY)
        frames = loop_frames(drawing, found)
        assert {frame.title for frame in frames} == set(found)
        for one, two in combinations(frames, 2):
            assert not any(_meet(a, b) for a in one.boxes for b in two.boxes), (
                name,
                one.title,
                two.title,
            )
        for frame in frames:
            for block, (x, y, width, height) in drawing.boxes.items():
                if not _belongs(block, found[frame.title]):
                    assert not any(
                        _meet(box, (x, y, x + width, y + height)) for box in frame.boxes
                    ), (name, block)
            for (
                left,
                top,
                right,
                bottom,
            ) in frame.boxes:  # in the picture with the thickness of its line
                assert min(left, top, drawing.width - right, drawing.height - bottom) >= 1, (
                    name,
                    frame.title,
                )
            assert block_diagram_svg(diagram, VOCABULARY).count(f">{frame.title}</text>") >= sum(
                one.title == frame.title for one in frames
            )
        for title, members in found.items():
            own = [frame for frame in frames if frame.title == title]
            for block, box in drawing.boxes.items():
                if _belongs(block, members) and not any(holds(frame, box) for frame in own):
                    outside.append((name, block))
    assert outside == []


@pytest.mark.slow
def test_the_bandwidth_of_a_pll_on_a_stiff_grid_is_the_closed_form():
    record = ibrid.evaluate(
        ibrid.textbook("gfl_l_filter"), measured(["p=0.8,q=0.1"], "gfl_l_filter")
    )
    (pll,) = [one for one in loop_modes(record) if one.loop == "PLL"]
    k_p, k_i = pll.gains["kP_pll"], pll.gains["kI_pll"]
    # L = (k_p s + k_i) / s^2 at |v| = 1: |L| = 1 at w^2 = (k_p^2 + sqrt(k_p^4 + 4 k_i^2)) / 2,
    # margin atan(k_p w / k_i)
    crossover = np.sqrt((k_p**2 + np.sqrt(k_p**4 + 4 * k_i**2)) / 2)
    assert pll.bandwidth == pytest.approx(
        crossover / (2 * np.pi), rel=0.01
    )  # the grid of frequencies
    assert pll.phase_margin == pytest.approx(np.degrees(np.arctan(k_p * crossover / k_i)), abs=0.5)
    assert pll.damping == pytest.approx(min(1.0, k_p / 2 / np.sqrt(k_i)), rel=1e-3)


@pytest.mark.slow
def test_a_page_shows_loops_with_bandwidth_and_si_where_the_bases_are_known():
    sweep = replace(benchmark(), s_base_va=10e3, v_base_v=400.0)
    record = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), sweep, restarts=0)
    rows = {row.name: row.readable for row in parameter_rows(record)}
    l_f = record.parameters["p=1,q=0.3"]["plant.L_g"] * 16.0 / (120 * np.pi)
    assert rows["plant.L_g"] == f"{l_f * 1e3:.3g} mH"
    assert in_si(0.05, "filter capacitance", 16.0, 120 * np.pi) == "8.29 uF"
    assert in_si(60.0, "proportional gain", 16.0, 120 * np.pi) == ""
    page = report_html(record)
    assert "phase margin" in page
    for one in loop_modes(record):
        assert f"<code>{one.regulator}</code>" in page


@pytest.mark.slow
def test_a_diagram_is_enlarged_by_its_button_and_fitted_again(tmp_path: Path):
    page = report_html(evaluated("gfl_pll_filter_exact", restarts=0))
    question = """
    const svg = document.querySelector("svg.diagram"), bar = document.querySelector(".zoombar"), found = [];
    const width = () => found.push(Math.round(svg.getBoundingClientRect().width));
    width();
    bar.children[0].click(); width();
    bar.children[0].click(); width();
    bar.children[2].click(); width();
    return found;
    """
    ((fitted, larger, largest, again),), console = asked([page], question, tmp_path)
    assert fitted < larger < largest
    assert again == fitted
    assert not [line for line in console if "Content Security" in line or "Error" in line]
