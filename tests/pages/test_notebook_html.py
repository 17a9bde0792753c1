"""Objects show themselves in notebooks: self-contained HTML that touches nothing around it."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fitted import benchmark, evaluated
from ibrid_search.running import Run
from made_gap import VERDICTS, made
from page_reader import Reader

import ibrid
from ibrid.analysis.grids.grid import SeriesRL
from ibrid.analysis.grids.stability import Stability
from ibrid.analysis.models.prediction import Prediction
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.report.look.style import notebook_style_sheet, style_sheet
from ibrid.report.pages.notebook import DRAWN


@pytest.fixture(scope="module")
def record() -> Record:
    return evaluated("gfl_pll_filter_exact", restarts=0)


@pytest.fixture(scope="module")
def predicted(record: Record) -> Prediction:
    return ibrid.predict(record, "p=0.5,q=0", np.geomspace(5, 5000, 20))


@pytest.fixture(scope="module")
def study(record: Record) -> Stability:
    return ibrid.stability(record, [1.2, 3.0, 10.0], op="p=1,q=0.3")


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
    assert (
        shown.count('class="node family') == 11
    )  # 13 modules, of which two are minus signs at sums
    assert ">pll_filter<" in shown


def test_a_diagram_without_modules_or_with_unknown_kinds_is_shown_too():
    assert "nothing to draw" in checked(ibrid.Diagram()._repr_html_())
    strange = ibrid.Diagram("strange")
    strange.add("Perpetuum", "mobile")
    assert "Perpetuum" in checked(strange._repr_html_())


@pytest.mark.slow
def test_a_sweep_shows_its_points_and_four_plots():
    sweep = ibrid.add_noise(benchmark(), 40, rng=np.random.default_rng(0))
    shown = checked(sweep._repr_html_())
    assert shown.count("<figure>") == 4
    assert all(name in shown for name in sweep.names)
    assert "known" in shown


@pytest.mark.slow
def test_a_sweep_of_many_points_draws_the_first_ones_and_says_so():
    (first, *_) = benchmark().points
    points = tuple(replace(first, op=replace(first.op, name=f"<{k}>")) for k in range(DRAWN + 2))
    shown = checked(Sweep(points)._repr_html_())
    assert "2 more operating points" in shown
    assert "&lt;7&gt;" in shown
    assert "<7>" not in shown


@pytest.mark.slow
def test_a_record_shows_verdict_response_and_diagram(record: Record):
    shown = checked(record._repr_html_())
    assert "to rounding" in shown
    assert "pll.kP_pll" in shown
    assert 'class="node family' in shown


@pytest.mark.slow
def test_a_record_whose_data_have_gone_shows_its_lines(record: Record):
    lost = replace(record, settings={**record.settings, "data": "gone.csv"})
    assert "gone.csv is not there" in checked(lost._repr_html_())


def test_a_record_without_a_fit_gives_its_reasons():
    failed = Record(
        outcome="invalid", reasons=("a <wire> is missing",), program="def build(g):\n    pass\n"
    )
    assert "a &lt;wire&gt; is missing" in checked(failed._repr_html_())
    assert "no program" in checked(replace(failed, program="no program")._repr_html_())


@pytest.mark.nightly
@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_gap_of_every_verdict_shows_its_sentence(verdict: str):
    gap = made(verdict)
    shown = checked(gap._repr_html_())
    assert verdict in shown
    assert "Error by operating point" in shown


@pytest.mark.slow
def test_a_search_shows_its_course_and_its_answer(record: Record):
    shown = checked(a_search(record)._repr_html_())
    assert "the budget &lt;is&gt; spent" in shown
    assert "Error over the evaluations" in shown
    assert 'class="node family' in shown


def test_a_search_without_an_answer_says_so():
    assert "No stable candidate" in checked(replace(a_search(None), trajectory=())._repr_html_())


@pytest.mark.slow
def test_a_prediction_shows_its_point_its_bands_and_its_warnings(predicted: Prediction):
    shown = checked(predicted._repr_html_())
    assert shown.count("<figure>") == 4
    assert "p=0.5,q=0" in shown
    assert "Shaded: its 95 % band" in shown
    assert "lies outside the measured range" in shown
    assert f'<data value="{float(np.max(predicted.relative_band))!r}">' in shown
    assert "pll.angle" in shown.partition("<summary>Modes</summary>")[2]


@pytest.mark.slow
def test_a_band_is_drawn_around_each_line_of_a_prediction(predicted: Prediction):
    bare = replace(predicted, deviation=None)._repr_html_()
    assert predicted._repr_html_().count("FillBetween") >= 8  # magnitude and phase of four entries
    assert "FillBetween" not in bare
    assert "no band" in checked(bare)


@pytest.mark.slow
def test_an_unstable_prediction_says_so_first(predicted: Prediction):
    worse = replace(
        predicted, modes=(replace(predicted.modes[0], pole=3 + 40j), *predicted.modes[1:])
    )
    assert "UNSTABLE" in checked(worse._repr_html_()).partition("<figure>")[0]


@pytest.mark.slow
def test_a_stability_study_shows_its_sentence_its_grids_and_folds_the_figures(study: Stability):
    shown = checked(study._repr_html_())
    (sentence,) = study.sentences
    before, _, after = shown.partition("<details>")
    assert sentence.split(":")[0] in before
    assert [f'<th scope="row">{scr}</th>' in before for scr in ("1.2", "3", "10")] == [True] * 3
    assert "<figure" not in before
    assert all(
        f"<summary>{title}" in f"<details>{after}"
        for title in ("Root locus", "Eigenloci", "Passivity", "Modes")
    )


@pytest.mark.slow
def test_a_study_of_one_given_grid_has_no_critical_ratio_and_is_shown_all_the_same(record: Record):
    one = ibrid.stability(record, grid=SeriesRL(0.03, 0.3, 2 * np.pi * 60), op="p=1,q=0.3")
    shown = checked(one._repr_html_())
    assert "Critical short-circuit ratios" not in shown
    assert "UNSTABLE" in shown or "stable" in shown


@pytest.mark.slow
def test_models_comparisons_and_analyses_are_short_and_show_themselves(record: Record):
    op = "p=1,q=0.3"
    values = (
        ibrid.power_jacobian(record, op, np.geomspace(5, 500, 5)),
        ibrid.residuals(record, benchmark()),
        ibrid.compare("gfl", "gfl_exact"),
        ibrid.predict(record, op, np.geomspace(5, 500, 5)).model,
        ibrid.nonlinear_model(record, op),
    )
    for value in values:
        assert re.fullmatch(rf"<{type(value).__name__}\W.{{,190}}>", repr(value))
        shown = checked(value._repr_html_())
        assert "<svg" in shown or "<pre>" in shown


def test_a_prediction_is_a_table_and_is_saved(predicted: Prediction, tmp_path: Path):
    table = predicted.to_dataframe()
    assert [*table.columns] == ["freq_hz", "entry", "real", "imaginary", "sigma"]
    assert table["imaginary"][2] == predicted.admittance[0, 1, 0].imag
    predicted.save(tmp_path / "point.json")
    saved = json.loads((tmp_path / "point.json").read_text())
    assert saved["points"][0]["op"] == predicted.op.name


def test_the_surroundings_of_minus_one_hide_the_curves_behind_them(study: Stability):
    loci = study._repr_html_().split("squeezed")  # of the plane's labels, before the inset's
    assert "fill: var(--page,canvas)" in "".join(loci[1:])


def test_outputs_beside_each_other_share_no_identifier(
    record: Record, predicted: Prediction, study: Stability
):
    elsewhere = ibrid.stability(record, [1.2, 3.0, 10.0], op="p=1,q=-0.3")
    objects = (record, benchmark(), a_search(record), predicted, study, elsewhere)
    outputs = [one._repr_html_() for one in objects]
    found = [set(re.findall(r'\bid="([^"]+)"', one)) for one in outputs]
    assert all(found)
    assert len(set().union(*found)) == sum(map(len, found))


@pytest.mark.slow
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


@pytest.mark.slow
def test_showing_costs_no_import_until_it_is_asked_for():
    code = (
        "import ibrid, sys; ibrid.Diagram(); ibrid.Sweep; ibrid.Record; "
        "print('ibrid.report.pages.notebook' in sys.modules)"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "False"
