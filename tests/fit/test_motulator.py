"""Control of motulator, which nobody here wrote: its sweep is explained by a published diagram with
the values of its source.
"""

from math import pi
from pathlib import Path

import pytest

import ibrid
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.motulator_bridge import Converter, MotulatorDevice

DEVICES = Path(__file__).resolve().parents[2] / "data" / "devices"
SWEEP = DEVICES / "motulator_gfl.csv"
BANDWIDTH, PLL, SAMPLE, INDUCTANCE = 2 * pi * 400, 2 * pi * 20, 1e-4, 2 * pi * 50 * 10e-3 / 12.8
#: By motulator's source; the fit is of a continuous control, so a tenth, and a fifth for gains that
#: share their sum.
TRUE = {
    "plant.L_F": (INDUCTANCE, 0.03),
    "pll.kP_pll": (2 * PLL, 0.02),
    "pll.kI_pll": (PLL**2, 0.05),
    "current.k": (-BANDWIDTH * 10e-3 / 12.8, 0.2),
    "resistance.k": (-BANDWIDTH * 10e-3 / 12.8, 0.2),
    "observer.omega_c": (BANDWIDTH, 0.1),
    "turned_in.L": (1 / BANDWIDTH, 0.1),
    "e_filter.omega_c": (2 * PLL, 0.1),
    "delay.T_d": (1.5 * SAMPLE, 0.1),
}


@pytest.mark.slow
def test_the_diagram_of_the_control_explains_its_sweep_with_the_values_of_its_source():
    record = ibrid.evaluate(
        ibrid.textbook("gfl_disturbance_observer"), ibrid.read_sweep(SWEEP), holdout_op="absorbing"
    )
    assert record.nrmse < 0.01
    assert record.holdout["absorbing"] < 0.02
    found = record.parameters["half"]
    for name, (value, tolerance) in TRUE.items():
        assert found[name] == pytest.approx(value, rel=tolerance), name


@pytest.mark.slow
def test_its_power_synchronisation_is_explained_with_the_values_of_its_source():
    sweep = ibrid.read_sweep(DEVICES / "motulator_gfm_psc.csv")
    record = ibrid.evaluate(
        ibrid.textbook("gfm_reference_feedforward"), sweep, holdout_op="absorbing"
    )
    assert record.nrmse < 0.005
    assert record.holdout["absorbing"] < 0.005
    found, active_resistance = record.parameters["half"], 0.25 / 2
    assert found["plant.L_F"] == pytest.approx(INDUCTANCE, rel=0.01)
    assert found["sync_gain.k"] == pytest.approx(-2 * pi * 50 * active_resistance, rel=0.01)
    # of the filter's and the active resistance the sum alone is seen
    assert found["plant.R_F"] - found["active_resistance.k"] == pytest.approx(
        active_resistance, rel=0.02
    )
    assert found["slow_gain.k"] == pytest.approx(active_resistance, rel=0.05)
    assert found["slow_q.omega_c"] == pytest.approx(2 * pi * 5, rel=0.05)


def test_a_control_that_motulator_lacks_or_no_motulator_is_one_sentence():
    with pytest.raises(
        IbridError,
        match=r"install it with: pip install 'ibrid\[motulator\]'|control must be one of",
    ):
        MotulatorDevice(Converter(control="wishful"))


def test_the_shipped_sweep_is_what_motulator_answers():
    pytest.importorskip(
        "motulator", reason="motulator is not installed (pip install 'ibrid[motulator]')"
    )
    shipped = ibrid.read_sweep(SWEEP).point("half")
    device = MotulatorDevice(Converter())
    point = device.settled(OperatingPoint("half", 0.5, 0.0))
    assert (point.p, point.q) == pytest.approx((shipped.op.p, shipped.op.q), abs=1e-9)
    number = list(shipped.frequency).index(376.0)
    answer = device(376.0, "q", point)
    assert abs(answer - shipped.admittance[number][:, 1]).max() < 1e-3 * abs(answer).max()
