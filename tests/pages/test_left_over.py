"""What is not explained: how much, where, what could explain it, what to measure; on pages and in
texts.
"""

from dataclasses import replace

import numpy as np
import pytest
from fitted import benchmark, evaluated, measured
from made_gap import device, made
from page_reader import Reader

import ibrid
from ibrid.analysis.models.loop_modes import loops_told
from ibrid.evaluation.record import Record
from ibrid.gap.results.gap import LocatedMisfit
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.report.facts.left_over import left_by_gap, left_by_record
from ibrid.report.pages.gap_page import gap_page
from ibrid.report.pages.page import report_html
from ibrid.report.texts.gap_text import gap_text
from ibrid.report.texts.text import format_record


def without_the_filter(points: int = 2) -> Record:
    """A fit of a model that lacks the low-pass before the PLL of the measured device."""
    sweep = device() if points == 3 else device().only(device().names[:points])
    return ibrid.evaluate(ibrid.textbook("gfl_exact"), sweep, restarts=0)


@pytest.mark.slow
def test_a_fit_tells_each_place_that_stands_out_of_the_noise():
    record = without_the_filter()
    left = left_by_record(record)
    assert left is not None
    assert record.misfit is not None
    assert [(one.op, one.entry, one.z) for one in left.places] == [
        (part["op"], part["entry"], part["z"]) for part in record.misfit["by_entry_band"]
    ]
    for place, part in zip(left.places, record.misfit["by_entry_band"], strict=True):
        assert place.error == record.nrmse_by_part[place.op][part["band"]][place.entry]
    ratio = float(left.amount.split(" times")[0].removeprefix("What is left is "))
    assert ratio**2 == pytest.approx(record.misfit["chi2_per_dof"], rel=0.01)  # three digits


@pytest.mark.slow
def test_loops_whose_bandwidth_lies_where_something_is_left_are_named():
    record = without_the_filter()
    left = left_by_record(record)
    assert left is not None
    assert record.misfit is not None
    bands = {part["band"] for part in record.misfit["by_entry_band"]}
    causes = " ".join(left.causes)
    for loop in loops_told(record):
        inside = [
            band
            for band in bands
            if loop.bandwidth is not None
            and float(band.split("-")[0]) <= loop.bandwidth < float(band.split("-")[1])
        ]
        assert (f"({loop.regulator}," in causes) == bool(inside), loop


@pytest.mark.slow
def test_what_to_measure_follows_from_what_was_measured():
    known = left_by_record(without_the_filter())
    assert known is not None
    assert not any("three times" in words for words in known.measure)  # sigma is stated
    assert any("Further operating points" in words for words in known.measure)
    more = left_by_record(without_the_filter(points=3))
    assert more is not None
    assert not any("Further operating points" in words for words in more.measure)
    clean = measured(["p=1,q=0.3", "p=1,q=-0.3"])
    unknown = left_by_record(ibrid.evaluate(ibrid.textbook("naive"), clean, restarts=0))
    assert unknown is not None
    assert "three times" in unknown.measure[0]


@pytest.mark.slow
def test_a_fit_that_explains_its_data_leaves_nothing():
    assert left_by_record(evaluated("gfl_pll_filter_exact", restarts=0)) is None
    noisy = add_noise(benchmark(), 60.0, rng=np.random.default_rng(7))
    record = ibrid.evaluate(ibrid.textbook("gfl_pll_filter_exact"), noisy, restarts=0)
    assert record.grade == "explains"
    assert left_by_record(record) is None


@pytest.mark.slow
def test_page_and_text_of_a_fit_say_the_same():
    record = without_the_filter()
    left = left_by_record(record)
    assert left is not None
    page, text = Reader(report_html(record)).text, " ".join(format_record(record).split())
    for words in (left.amount, *left.causes, *left.measure):
        assert words in page, words
        assert words in text, words
    assert left.places[0].words in text
    assert "What is not explained" in page
    explained = report_html(evaluated("gfl_pll_filter_exact", restarts=0))
    assert "What is not explained" not in Reader(explained).text


@pytest.mark.slow
@pytest.mark.parametrize("verdict", ["located-unnamed", "unexplained"])
def test_a_gap_without_a_name_says_places_ports_and_measurements(verdict: str):
    gap = made(verdict)
    left = left_by_gap(gap)
    assert left is not None
    located = [one for one in gap.located if isinstance(one, LocatedMisfit)]
    assert [(one.op, one.entry, one.share, one.z) for one in left.places] == [
        (one.op, one.entry, one.share, one.z) for one in located
    ]
    adequate = [one.port.name for one in gap.ports if one.adequate]
    causes = " ".join(left.causes)
    assert all(f"({name})" in causes for name in adequate)
    if gap.ports and not adequate:
        assert "No single place explains all of it" in causes
        assert gap.ports[0].port.words in causes
    page = Reader(gap_page(gap)).text
    text = " ".join(gap_text(gap).split())
    for words in left.measure:
        assert words in page
    assert left.measure[0] in text
    for effect in gap.could_not_have_seen[:1]:
        assert effect.id in " ".join(left.measure)


@pytest.mark.slow
def test_a_gap_that_has_a_name_leaves_nothing():
    for verdict in ("no-gap", "parameters-only", "named", "data-convention"):
        assert left_by_gap(made(verdict)) is None, verdict
    assert left_by_gap(replace(made("unexplained"), located=())) is None
