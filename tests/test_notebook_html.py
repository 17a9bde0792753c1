"""Objects show themselves in notebooks: self-contained HTML that touches nothing around it."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitted import benchmark, evaluated
from made_gap import VERDICTS, made
from page_reader import Reader

import ibrid
from ibrid.evaluation.record import Record
from ibrid.measurement.sweep import Sweep
from ibrid.report.notebook import DRAWN
from ibrid.report.style import notebook_style_sheet, style_sheet
from search.running import Run


@pytest.fixture(scope="module")
def record() -> Record:
    return evaluated("gfl_pll_filter_exact", restarts=0)


def a_search(best: Record | None) -> Run:
    points = ((1, 0.978, 0.978), (2, None, 0.978), (3, 0.4, 0.4), (4, 0.9, 0.4))
    return Run(Path("run"), best, "the budget <is> spent", 4, 1.0, points, {}, {}, {}, True)


def checked(html: str) -> str:
    """The output without its style; whole, in one element, without scripts, and loading nothing."""
    assert not Reader(html).open
    assert html.startswith('<div class="ibrid"><style>')
    assert html.count("<style>") == 1
    assert not re.search(r"<script|javascript:|\son\w+=|(?:src|href)=\"(?!#)|url\((?!#)", html)
    return html.partition("</style>")[2]


def test_a_diagram_is_drawn():
    shown = checked(ibrid.textbook("gfl_pll_filter_exact")._repr_html_())
    assert shown.count('class="node family') == 13
    assert ">pll_filter<" in shown


def test_a_diagram_without_modules_or_with_unknown_kinds_is_shown_too():
    assert "nothing to draw" in checked(ibrid.Diagram()._repr_html_())
    strange = ibrid.Diagram("strange")
    strange.add("Perpetuum", "mobile")
    assert "Perpetuum" in checked(strange._repr_html_())


def test_a_sweep_shows_its_points_and_four_plots():
    sweep = ibrid.add_noise(benchmark(), 40, rng=np.random.default_rng(0))
    shown = checked(sweep._repr_html_())
    assert shown.count("<figure>") == 4
    assert all(name in shown for name in sweep.names)
    assert "known" in shown


def test_a_sweep_of_many_points_draws_the_first_ones_and_says_so():
    (first, *_) = benchmark().points
    points = tuple(replace(first, op=replace(first.op, name=f"<{k}>")) for k in range(DRAWN + 2))
    shown = checked(Sweep(points)._repr_html_())
    assert "2 more operating points" in shown
    assert "&lt;7&gt;" in shown
    assert "<7>" not in shown


def test_a_record_shows_verdict_response_and_diagram(record: Record):
    shown = checked(record._repr_html_())
    assert "to rounding" in shown
    assert "pll.kP_pll" in shown
    assert 'class="node family' in shown


def test_a_record_whose_data_have_gone_shows_its_lines(record: Record):
    lost = replace(record, settings={**record.settings, "data": "gone.csv"})
    assert "gone.csv is not there" in checked(lost._repr_html_())


def test_a_record_without_a_fit_gives_its_reasons():
    failed = Record(outcome="invalid", reasons=("a <wire> is missing",), program="def build(g):\n    pass\n")
    assert "a &lt;wire&gt; is missing" in checked(failed._repr_html_())
    assert "no program" in checked(replace(failed, program="no program")._repr_html_())


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_gap_of_every_verdict_shows_its_sentence(verdict: str):
    gap = made(verdict)
    shown = checked(gap._repr_html_())
    assert verdict in shown
    assert "Error by operating point" in shown


def test_a_search_shows_its_course_and_its_answer(record: Record):
    shown = checked(a_search(record)._repr_html_())
    assert "the budget &lt;is&gt; spent" in shown
    assert "Error over the evaluations" in shown
    assert 'class="node family' in shown


def test_a_search_without_an_answer_says_so():
    assert "No stable candidate" in checked(replace(a_search(None), trajectory=())._repr_html_())


def test_outputs_beside_each_other_share_no_identifier(record: Record):
    outputs = [record._repr_html_(), benchmark()._repr_html_(), a_search(record)._repr_html_()]
    found = [set(re.findall(r'\bid="([^"]+)"', one)) for one in outputs]
    assert all(found)
    assert len(set().union(*found)) == sum(map(len, found))


def test_the_same_object_gives_the_same_output(record: Record):
    assert record._repr_html_() == record._repr_html_()


def test_the_style_is_that_of_the_pages_and_stays_inside():
    inside, page = notebook_style_sheet(), style_sheet()
    assert "svg.diagram{" in inside
    assert "svg.diagram{" in page
    assert "@media print" not in inside
    assert all(line.startswith((".ibrid", "[data-")) for line in top_level(inside))


def top_level(css: str) -> list[str]:
    """Selectors of the outermost rules."""
    depth, start, found = 0, 0, []
    for place, sign in enumerate(css):
        if sign == "{":
            found += [css[start:place].strip()] if depth == 0 else []
            depth += 1
        elif sign == "}":
            depth -= 1
            start = place + 1
    assert depth == 0
    return found


def test_showing_costs_no_import_until_it_is_asked_for():
    code = (
        "import ibrid, sys; ibrid.Diagram(); ibrid.Sweep; ibrid.Record; print('ibrid.report.notebook' in sys.modules)"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "False"
