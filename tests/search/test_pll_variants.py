"""A first answer about a device whose PLL leaves voltage on its q axis: grid-following, whatever
else may fit.
"""

import numpy as np
import pytest
from ibrid_search.starting.control_families import describe_family, list_synchronisations
from ibrid_search.starting.start import start
from ibrid_search.starting.start_result import DiagramFit, StartResult
from off_axis_inverter import OffAxisInverter

import ibrid
from ibrid.modules.vocabulary import VOCABULARY

FOLLOWING = "grid-following, a PLL gives its angle"
SLOWER = 2 * np.pi * 2.0
POINTS = [(0.9, 0.1, 1.0), (0.4, -0.3, 1.0)]
FREQUENCY = np.geomspace(1, 3000, 24)
BEHIND_L = {"C_F": 0.0, "L_g": 0.0, "R_g": 0.0, "node": "pcc"}
CONSTANT = {"kP": 0.0, "kI": 0.0, "ahead": 0.0, "decoupled": 0.0}


def first_answer(
    sweep: ibrid.Sweep, shipped: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> StartResult:
    """As if only these diagrams shipped."""
    monkeypatch.setattr("ibrid_search.screening.edit_screening.shipped_names", lambda: shipped)
    return start(sweep, tell=lambda words, share: None, effort="low")


@pytest.mark.slow
def test_the_right_diagram_with_a_proportional_pll_explains_the_device(monkeypatch):
    sweep = OffAxisInverter(slower=SLOWER).sweep(POINTS, FREQUENCY)
    answer = first_answer(sweep, ("hybrid_gfl_gfm", "gfm_direct_droop", "gfl_exact"), monkeypatch)
    assert (answer.best.diagram, answer.best.grade) == ("gfl_exact with SRF_PLL_P", "explains")
    assert answer.family == FOLLOWING
    assert answer.alternative == ""
    values = answer.best.record.parameters["op0"]
    assert values["pll.e_q_ref"] == pytest.approx(SLOWER / 60.0, rel=1e-6)
    assert max(answer.best.held_out.values()) < 1e-6


@pytest.mark.slow
def test_constant_current_without_feedforward_has_a_diagram_that_ships(monkeypatch):
    sweep = OffAxisInverter(slower=-SLOWER, **BEHIND_L, **CONSTANT).sweep(POINTS, FREQUENCY)
    answer = first_answer(sweep, ("gfm_direct_droop", "gfl_l_filter", "gfl_type1_pll"), monkeypatch)
    assert answer.best.diagram.startswith("gfl_type1_pll")
    assert answer.best.grade in (
        "explains",
        "close",
    )  # its PLL has a low-pass, which the device has not
    assert answer.family == FOLLOWING


@pytest.mark.slow
def test_a_grid_forming_device_stays_one(monkeypatch):
    data = ibrid.read_sweep(ibrid.benchmarks()["gfm_droop"])
    noisy = ibrid.add_noise(data, noise_db=40, repeats=3, rng=np.random.default_rng(5))
    answer = first_answer(noisy, ("gfm_droop", "gfl_l_filter"), monkeypatch)
    assert (answer.best.diagram, answer.best.grade) == ("gfm_droop", "explains")
    assert answer.alternative == ""


def test_another_family_that_fits_no_worse_is_said_in_the_answer():
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    words = describe_family("power, voltage loop")
    ranked = (DiagramFit("gfl", 1e-3, "close"), DiagramFit("gfm_vsm", 1e-3, "close"))
    answer = StartResult(
        sweep, ibrid.inspect(sweep), ranked, FOLLOWING, alternative=f"gfm_vsm ({words})"
    )
    assert f"gfm_vsm ({words}) is as close: these data do not tell which" in answer.sentence


def test_what_sets_the_frequency_is_told_of_each_sort():
    told = {
        name: list_synchronisations(ibrid.textbook(name), VOCABULARY)
        for name in ("gfl", "gfm_vsm", "hybrid_gfl_gfm")
    }
    assert told == {"gfl": {"phase"}, "gfm_vsm": {"power"}, "hybrid_gfl_gfm": {"phase", "power"}}
    assert list_synchronisations(ibrid.textbook("parallel_gfl_gfm"), VOCABULARY) == {
        "phase",
        "power",
    }
    assert list_synchronisations(ibrid.textbook("gfl_type1_pll"), VOCABULARY) == {"phase"}
