"""Reference inverters measured as devices: their analytic admittance comes back."""

import numpy as np
import pytest
from collecting import each_of
from scipy.optimize import fsolve

import ibrid
from ibrid.devices import DeviceFile, measure_events
from ibrid.devices.device_file import device_of
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants import plant_named, state_space
from ibrid.plants.sweeping import frequency_grid

NAMES = ("paper_like", "gfl_l_filter", "gfm_droop", "gfm_vsm")


def reference(name: str, tmp_path, step_s: float) -> DeviceFile:
    return device_of({"kind": "reference", "file": name, "step_s": step_s}, tmp_path, "the device")


def at_the_terminals(name: str, op: OperatingPoint) -> OperatingPoint:
    """The operating point at the inverter's own power node that delivers p and q at its
    terminals.
    """
    plant = plant_named(name)

    def missing(power: np.ndarray) -> list[float]:
        own = OperatingPoint("own", *power.tolist(), op.v)
        d, q = np.array(plant.dynamics.g(plant.at_rest(own).x, [op.v, 0.0])).ravel().tolist()
        return [op.v * d - op.p, -op.v * q - op.q]

    return OperatingPoint("own", *fsolve(missing, [op.p, op.q], xtol=1e-13).tolist(), op.v)


def error(name: str, point: "ibrid.measurement.sweeps.sweep.PointSweep") -> np.ndarray:
    truth = state_space(plant_named(name), at_the_terminals(name, point.op)).admittance(
        point.frequency
    )
    return np.linalg.norm(point.admittance - truth, axis=(1, 2)) / np.linalg.norm(
        truth, axis=(1, 2)
    )


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
def test_the_analytic_admittance_comes_back(name: str, tmp_path):
    device = reference(name, tmp_path, 5e-5)
    sweep = ibrid.measure(device, ["p=0.6,q=0.2"], frequency_grid("5:1000:20"))
    (point,) = sweep.points
    assert point.op.pqv == pytest.approx((0.6, 0.2, 1.0), abs=2e-5)
    # odd powers of half a per cent of voltage, and the spline between samples of a twentieth of the
    # shortest period
    assert error(name, point).max() < 1e-4
    assert (
        np.linalg.norm(point.sigma, axis=(1, 2))
        < 1e-3 * np.linalg.norm(point.admittance, axis=(1, 2))
    ).all()


@pytest.mark.slow
@each_of(
    ("name", "event"),
    [
        ("gfl_l_filter", "p_ref:0.8,at=0.1,for=0.1"),
        ("gfl_l_filter", "q_ref:-0.1,at=0.1"),
        ("gfm_droop", "p_ref:0.7,at=0.1"),
    ],
)
def test_a_set_point_moves_a_device_as_it_moves_the_inverter(name: str, event: str, tmp_path):
    """Two ways to the same numbers: told from sample to sample, and the whole record at once."""
    from ibrid.playback.recording import event_of, record_events

    op = OperatingPoint("asked", 0.6, 0.2)
    (device_record,) = measure_events(reference(name, tmp_path, 1e-4), [op], [event]).records
    own = at_the_terminals(name, device_record.rest)
    (record,) = record_events(plant_named(name), [own], [event_of(event)], rate=1e4).records
    (role,) = record.told
    assert device_record.rest_end == pytest.approx(record.rest_end, abs=2e-4)
    # the device's set point at rest is found to 2e-5
    np.testing.assert_allclose(device_record.told[role], record.told[role][::2], atol=1e-4)
    assert np.abs(record.i - record.i[0]).max() > 0.05
    # lines between samples, in place of a spline through them
    np.testing.assert_allclose(device_record.i, record.i[::2], atol=1e-4)


@pytest.mark.slow
def test_a_set_point_that_an_inverter_is_not_told_is_refused(tmp_path):
    said = "gfm_droop is not told q_ref, it takes p_ref; choose another event"
    with pytest.raises(IbridError, match=said):
        measure_events(reference("gfm_droop", tmp_path, 1e-4), ["p=0.6,q=0.2"], ["q_ref:0.3"])


@pytest.mark.slow
def test_a_record_of_a_reference_device_is_that_of_the_reference_inverter(tmp_path):
    """Two ways to the same numbers: blocks of samples, and the whole record at once."""
    from ibrid.playback.recording import event_of, record_events

    op = OperatingPoint("asked", 0.6, 0.2)
    (device_record,) = measure_events(
        reference("paper_like", tmp_path, 1e-4), [op], ["dip:0.7"]
    ).records
    own = at_the_terminals("paper_like", device_record.rest)
    (record,) = record_events(
        plant_named("paper_like"), [own], [event_of("dip:0.7")], rate=1e4
    ).records
    np.testing.assert_allclose(device_record.v, record.v[::2], atol=1e-12)
    np.testing.assert_allclose(device_record.i, record.i[::2], atol=2e-6)


def test_a_set_point_that_a_device_does_not_take_is_refused():
    class Load:
        def step(self, t, v_abc):
            return -0.5 * v_abc

    with pytest.raises(IbridError, match="moves p_ref, and the device takes none of"):
        measure_events(Load(), ["p=-0.5,q=0"], ["p_ref:0.8"])
