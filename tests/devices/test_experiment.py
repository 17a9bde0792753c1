"""Settle, inject, estimate: devices whose admittance is a closed form, measured."""

import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid.devices import DeviceBench, MeasureSettings, measure_events
from ibrid.devices.frame import to_phases, turning
from ibrid.errors import IbridError, OperatingPointError
from ibrid.measurement.sweeps.sweep import OperatingPoint

FREQUENCY = (20.0, 45.0, 90.0, 300.0, 800.0)
STEP, F0 = 5e-4, 50.0


class Branch:
    """A branch i[k] = a i[k-1] - b v[k] in each phase, behind which a source delivers p_ref and
    q_ref: all in closed form.

    noise : standard deviation of each phase current. cubic : -cubic |v|^2 v more of it.
    """

    def __init__(
        self, a: float = 0.6, b: float = 0.8, noise: float = 0.0, cubic: float = 0.0
    ) -> None:
        self.a, self.b, self.noise, self.cubic = a, b, noise, cubic
        self.p_ref, self.q_ref = 0.0, 0.0
        self.branch = np.zeros(3)
        self.rng = np.random.default_rng(3)

    def step(self, t: float, v_abc: np.ndarray) -> np.ndarray:
        self.branch = self.a * self.branch - self.b * v_abc
        source = (self.p_ref - 1j * self.q_ref) * np.exp(2j * np.pi * F0 * t)
        turned = np.real(source * np.exp(-2j * np.pi * np.arange(3) / 3))
        square = 2 / 3 * float(v_abc @ v_abc)
        return (
            self.branch
            + turned
            - self.cubic * square * v_abc
            + self.noise * self.rng.standard_normal(3)
        )

    def admittance(self, frequency: np.ndarray) -> np.ndarray:
        """(K, 2, 2): z = exp(j (omega +- omega_0) h) of the phases, as seen from the frame that
        turns.
        """
        above, below = (
            -self.b / (1 - self.a * np.exp(-2j * np.pi * (sign * frequency + F0) * STEP))
            for sign in (1, -1)
        )
        along = (above + below.conj()) / 2
        across = (above - below.conj()) / 2j
        return np.moveaxis(np.array([[along, -across], [across, along]]), 2, 0)

    def power(self) -> complex:
        """p + j q at v = 1 with the source at zero."""
        return complex(
            -self.b / (1 - self.a * np.exp(-2j * np.pi * F0 * STEP)) - self.cubic
        ).conjugate()


def errors(point: ibrid.measurement.sweeps.sweep.PointSweep, truth: np.ndarray) -> np.ndarray:
    return np.linalg.norm(point.admittance - truth, axis=(1, 2)) / np.linalg.norm(
        truth, axis=(1, 2)
    )


def test_a_linear_device_is_measured_to_rounding():
    device = Branch()
    sweep = ibrid.measure(device, ["p=0.5,q=0.2", "p=-0.3,q=0,v=1.05"], FREQUENCY, step_s=STEP)
    assert [point.op.pqv for point in sweep.points] == [
        pytest.approx((0.5, 0.2, 1.0), abs=2e-5),
        pytest.approx((-0.3, 0.0, 1.05), abs=2e-5),
    ]
    for point in sweep.points:
        # sums of 1e4 samples, of a small part of the current
        assert errors(point, device.admittance(point.frequency)).max() < 1e-9
    assert device.branch.tolist() == [0.0, 0.0, 0.0]  # a copy was measured


def test_sigma_is_as_large_as_the_error_that_noise_makes():
    device = Branch(noise=1e-3)
    (point,) = ibrid.measure(device, ["p=0.5,q=0.2"], np.geomspace(20, 800, 20), step_s=STEP).points
    error = point.admittance - device.admittance(point.frequency)
    squares = np.abs(error) ** 2 / (2 * point.sigma**2)
    # a mean of 120 squares, sigma itself from few bins and periods
    assert 0.3 < squares.mean() < 2.0


def test_what_odd_powers_change_is_within_sigma_and_said_where_it_is_much():
    device = Branch(cubic=0.05)
    (point,) = ibrid.measure(device, [operating_point(device)], FREQUENCY, step_s=STEP).points
    truth = device.admittance(point.frequency) - 0.05 * np.diag([3.0, 1.0])
    error = np.abs(point.admittance - truth)
    assert errors(point, truth).max() < 1e-4
    assert (error < 5 * point.sigma).all()
    with pytest.warns(
        UserWarning,
        match=r"is not linear: odd powers of the injected voltage make .* smaller --peak",
    ):
        ibrid.measure(
            device,
            [operating_point(device)],
            FREQUENCY,
            step_s=STEP,
            settings=MeasureSettings(peak=0.9),
        )


def operating_point(device: Branch) -> str:
    power = device.power()
    return f"p={power.real},q={power.imag}"


def test_a_device_without_references_is_measured_where_it_rests():
    class Fixed(Branch):
        def __init__(self) -> None:
            super().__init__()
            del self.p_ref, self.q_ref

        def step(self, t: float, v_abc: np.ndarray) -> np.ndarray:
            self.branch = self.a * self.branch - self.b * v_abc
            return self.branch

    device = Fixed()
    (point,) = ibrid.measure(device, [operating_point(device)], FREQUENCY, step_s=STEP).points
    assert errors(point, device.admittance(point.frequency)).max() < 1e-9
    with pytest.raises(
        OperatingPointError, match=r"takes no p_ref and q_ref, and rests at p=-1\.86"
    ):
        ibrid.measure(device, ["p=0.5,q=0"], FREQUENCY, step_s=STEP)


def test_a_current_that_counts_the_other_way_is_said():
    class Backwards(Branch):
        def step(self, t: float, v_abc: np.ndarray) -> np.ndarray:
            return -super().step(t, v_abc)

    with pytest.raises(
        OperatingPointError, match=r"its current counts the other way; write sign = -1 at i in"
    ):
        ibrid.measure(Backwards(b=1e-3), ["p=0.5,q=0.2"], FREQUENCY, step_s=STEP)


def test_a_device_that_grows_and_one_that_never_rests_are_said():
    with pytest.raises(
        OperatingPointError, match=r"is unstable at p=0\.5,q=0: its current passes 20 per unit"
    ):
        ibrid.measure(Branch(a=1.01), ["p=0.5,q=0"], FREQUENCY, step_s=STEP)

    class Ringing(Branch):
        def step(self, t: float, v_abc: np.ndarray) -> np.ndarray:
            return super().step(t, v_abc) * (1 + 0.1 * np.sin(17.0 * t))

    with pytest.raises(
        OperatingPointError, match=r"must rest at p=0\.5,q=0; after 2 simulated seconds"
    ):
        ibrid.measure(
            Ringing(),
            ["p=0.5,q=0"],
            FREQUENCY,
            step_s=STEP,
            settings=MeasureSettings(longest_s=2.0),
        )


class Starting:
    """No current before 1 s; then it comes to 0.5 on d from 0.005 above, with a time constant of 1
    s.
    """

    def play(self, first: int, v: np.ndarray) -> np.ndarray:
        t = (first + np.arange(len(v))) * STEP
        d = np.where(t < 1.0, 0.0, 0.5 + 0.005 * np.exp(1.0 - t))
        return to_phases(d + 0j, turning(first, len(v), STEP, F0))


@each_of("settle_s", [1.5, 25.0])
def test_rest_before_a_device_has_started_does_not_count(settle_s: float):
    """Neither as a sign that what moves is noise, nor of the time in which it must settle."""
    bench = DeviceBench(Starting(), STEP, F0, longest_s=20.0, settle_s=settle_s)
    rest = bench.settle(OperatingPoint("start", 0.5, 0.0))
    assert rest.p == pytest.approx(0.5, abs=1e-5)
    assert bench.simulated_s >= settle_s


def test_a_frequency_reference_is_set_to_the_nominal_frequency():
    put = {}

    class Following(Starting):
        def put(self, reference: str, value: float) -> None:
            put[reference] = value

    DeviceBench(Following(), STEP, F0, settle_s=1.5).reach(
        OperatingPoint("start", 0.5, 0.0), ("f_ref",)
    )
    assert put == {"f_ref": 1.0}


@each_of("setting", ["rate", "longest_s"])
def test_a_setting_that_no_measurement_has_is_said(setting: str):
    for value in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(
            IbridError, match=f"{setting} must be a finite number above 0; found {value:g}"
        ):
            MeasureSettings(**{setting: value})


def test_records_of_events_are_what_the_device_answers():
    device = Branch()
    events = measure_events(
        device,
        ["p=0.5,q=0.2"],
        ["dip:0.6", "phase:20"],
        step_s=STEP,
        settings=MeasureSettings(rate=1000.0),
    )
    assert events.names == ("dip:0.6", "phase:20")
    record = events["dip:0.6"]
    assert (record.rest.p, record.rest.q) == pytest.approx((0.5, 0.2), abs=2e-5)
    assert np.diff(record.time) == pytest.approx(1e-3)
    during = record.i[np.searchsorted(record.time, 0.2)]
    # the branch follows the voltage at once, what the source delivers stays
    moved = complex(*during) - complex(*record.i[0])
    assert moved == pytest.approx(-0.4 * device.power().conjugate(), abs=1e-6)


def test_what_is_no_device_is_refused():
    with pytest.raises(
        IbridError,
        match=r"a device is a DEVICE.toml or an object with step\(t, v_abc\); found a int",
    ):
        ibrid.measure(3, ["p=0.5,q=0"], FREQUENCY, step_s=STEP)
    with pytest.raises(IbridError, match=r"there must be an operating point to measure at"):
        ibrid.measure(Branch(), [], FREQUENCY, step_s=STEP)
