"""Sorts of control: what makes the frequency and whether the voltage is controlled, and nothing
else.
"""

import pytest
from collecting import each_of
from ibrid_bench.search.inverters import inverter
from ibrid_search.archives.appraisal import sort_of_control

from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagrams.library import textbook


@each_of(
    ("hidden", "sort"),
    [
        ("paper_like", "phase"),
        ("gfl_l_filter", "phase"),
        ("gfl_dc_link", "phase"),
        ("gfm_droop", "power, voltage loop"),
        ("gfm_vsm", "power, voltage loop"),
        ("gfm_dvoc", "oscillator, voltage loop"),
        ("hybrid_gfl_gfm", "phase and power"),
        ("parallel_gfl_gfm", "phase beside power, voltage loop"),
    ],
)
def test_every_reference_inverter_is_of_the_sort_that_an_engineer_would_name(hidden, sort):
    assert sort_of_control(inverter(hidden).truth, VOCABULARY) == sort


def test_whatever_filters_what_a_pll_locks_to_the_frequency_follows_the_phase():
    for name in (
        "gfl_ddsrf_open_loop",
        "gfl_dsogi_pll",
        "gfl_dual_current",
        "gfl_ll_droop",
        "gfl_pcc_voltage",
        "gfl_shared_sensors",
    ):
        assert sort_of_control(textbook(name), VOCABULARY) == "phase", name


def test_without_a_frame_of_its_own_the_frequency_follows_nothing():
    assert sort_of_control(textbook("naive"), VOCABULARY) == "nothing"


@pytest.mark.slow
@pytest.mark.parametrize(
    "hidden", ["filtered_feedforward", "no_decoupling", "pll_and_power_filters", "delay", "unusual"]
)
def test_filters_feedforward_decoupling_and_delay_make_no_other_sort(hidden):
    assert sort_of_control(inverter(hidden).truth, VOCABULARY) == "phase"
