"""Numbers of pages and texts are those that an engineer would write down."""

from dataclasses import replace

import ibrid
from ibrid.analysis.models.loop_modes import loop_modes
from ibrid.measurement.quality.inspection_table import format_inspection
from ibrid.report.facts.bands import band_in_hz, measured_band
from ibrid.report.pages.page import report_html


def test_what_a_solver_left_of_a_set_point_of_zero_is_shown_as_zero():
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    point = replace(sweep.points[0], op=replace(sweep.points[0].op, p=0.5, q=1.058e-10))
    text = format_inspection(ibrid.inspect(replace(sweep, points=(point,))))
    assert "0.5, 0, " in text


def test_a_band_ends_where_the_measurement_does():
    record = ibrid.evaluate("naive", "paper_like", restarts=0)
    ended = replace(record, settings={**record.settings, "frequency_hz": [1.0, 1200.0]})
    assert measured_band(ended, "5-50") == (1.0, 50.0)
    assert measured_band(ended, "500-2000") == (500.0, 1200.0)
    assert measured_band(ended, "2000-5000") == (2000.0, 5000.0)  # nothing was measured there
    at_2_khz = replace(record, settings={**record.settings, "frequency_hz": [1.0, 2000.0]})
    assert band_in_hz(at_2_khz, "2000-5000") == "2000"
    assert band_in_hz(at_2_khz, "50-500") == "50-500"


def test_gains_are_shown_with_their_units():
    record = ibrid.evaluate("gfl_l_filter", ibrid.benchmarks()["gfl_l_filter"], restarts=0)
    (pll,) = [one for one in loop_modes(record) if one.loop == "PLL"]
    assert pll.units["kP_pll"] == "rad/s/pu"
    table = report_html(record).split('aria-label="Control loops"')[-1].split("</table>")[0]
    assert " rad/s^2/pu" in table
    assert {unit for one in loop_modes(record) for unit in one.units.values()}.isdisjoint({"1"})
