"""Diagrams as engineers draw them: minus at the sum, values in blocks, loops framed and named,
zoom, bandwidth, damping.
"""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from browser import asked
from fitted import benchmark, evaluated, measured

import ibrid
from ibrid.analysis.models.loop_modes import loop_modes
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.block_diagrams.block_diagram import block_diagram_svg
from ibrid.report.block_diagrams.block_graph import block_graph
from ibrid.report.block_diagrams.drawing import arrange
from ibrid.report.block_diagrams.loop_frames import Frame, _belongs, _meet, loop_frames
from ibrid.report.facts.parameter_rows import parameter_rows, values_of
from ibrid.report.look.numbers import in_si
from ibrid.report.pages.page import report_html
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import shipped_names, textbook
from ibrid.structure.editing.loops import loops


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
