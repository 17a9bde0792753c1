"""Fits to published hardware sweeps; skipped where the data are not on the machine (data/README.md
says how to get them).
"""

import numpy as np
import pytest

import ibrid
from ibrid.evaluation.record import Record
from ibrid.gap.workflow import find_gap
from ibrid.measurement.hardware import VARIABLE, hardware_sweeps
from ibrid.measurement.sweeps.sweep import Sweep

FOUND = hardware_sweeps()
pytestmark = pytest.mark.skipif(
    "gti_pq" not in FOUND,
    reason=f"the hardware sweep gti_pq.csv is not here; set {VARIABLE} to its folder, see "
    "data/README.md",
)
SAMPLING = 20e3  # Hz, of the published inverter


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    return ibrid.read_sweep(FOUND["gti_pq"])


@pytest.fixture(scope="module")
def record(sweep: Sweep) -> Record:
    return ibrid.evaluate(ibrid.textbook("gfl_l_filter_delay"), sweep)


def millihenry(record: Record, sweep: Sweep) -> float:
    assert sweep.s_base_va is not None
    assert sweep.v_base_v is not None
    per_unit = record.parameters[sweep.names[0]]["plant.L_F"]
    return per_unit * sweep.v_base_v**2 / sweep.s_base_va / (2 * np.pi * sweep.f0_hz) * 1e3


@pytest.mark.slow
def test_the_filter_and_the_delay_of_the_hardware_are_found(sweep: Sweep, record: Record):
    assert record.outcome == "ok"
    assert record.nrmse is not None
    assert record.nrmse < 0.3
    assert 0.8 * 0.97 < millihenry(record, sweep) < 1.2 * 1.0  # 0.97 to 1.0 mH by the publication
    periods = record.parameters[sweep.names[0]]["delay.T_d"] * SAMPLING
    assert 1.0 < periods < 2.0  # computation of one period and half a period of the modulator
    assert all(record.stable.values())


@pytest.mark.nightly
def test_without_the_delay_the_hardware_fits_worse(sweep: Sweep, record: Record):
    without = ibrid.evaluate(ibrid.textbook("gfl_l_filter"), sweep, restarts=1)
    assert without.nrmse is not None
    assert record.nrmse is not None
    assert without.nrmse > 1.2 * record.nrmse


@pytest.mark.nightly
def test_shared_and_separate_parameters_and_the_other_point_are_comparable(
    sweep: Sweep, record: Record
):
    apart = ibrid.evaluate(
        ibrid.textbook("gfl_l_filter_delay"), sweep, parameters="per-op", restarts=1
    )
    assert apart.nrmse is not None
    assert record.nrmse is not None
    assert apart.nrmse <= record.nrmse * 1.001
    for name in sweep.names:
        predicted = ibrid.evaluate(
            ibrid.textbook("gfl_l_filter_delay"), sweep, holdout_op=name, restarts=1
        )
        assert np.isfinite(predicted.holdout[name])
        assert predicted.holdout[name] < 2 * record.nrmse_by_op[name]


@pytest.mark.nightly
def test_the_gap_finds_that_p_and_q_were_labelled_sqrt_2_too_large():
    path = FOUND["gti_pq"].parent / "as_first_labelled" / "gti_pq.csv"
    gap = find_gap(ibrid.textbook("gfl_l_filter_delay"), ibrid.read_sweep(path), progress="silent")
    assert gap.verdict == "data-convention"
    (label,) = [one for one in gap.effects if one.where == "the labels of the data"]
    assert (label.id, label.parameters["scale"][0]) == ("power_scale", 2**0.5)
    assert gap.after["refit"] < 0.15 < gap.before["refit"]
    assert "the rest is not explained" in gap.sentence


@pytest.mark.nightly
def test_where_other_labels_leave_least_that_is_said_though_they_explain_too_little_to_be_named():
    """p was a factor 1.65 too large and v 1.17: of both a response shows p/v^2 alone, 1.21 too
    large, in noise of 8 %.
    """
    path = FOUND["gti_pq"].parent / "as_first_labelled" / "gti_ki20.csv"
    gap = find_gap(ibrid.textbook("gfl_delay_angle"), ibrid.read_sweep(path), progress="silent")
    assert gap.verdict == "unexplained"
    assert {one.id for one in gap.candidates[:3]} == {
        "voltage_scale",
        "power_scale",
        "base_impedance",
    }
    assert (
        "times the true one (or it is power scale or base impedance: these data cannot tell)"
        in gap.sentence
    )
