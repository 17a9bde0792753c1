"""Sweeps at several injection amplitudes: kept apart when read, compared by the linearity gate;
describing functions.
"""

from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.hidden.bases import draw_base
from ibrid_bench.hidden.device import OMEGA_60, Device, admittance, stable
from ibrid_bench.hidden.injection import injected
from ibrid_bench.hidden.nonlinear import Nonlinearity
from scipy.integrate import quad
from sharing import shared

from ibrid.errors import IbridError, SweepError
from ibrid.gap.amplitudes.nonlinearities import (
    dead_zone_gain,
    held_limit_gain,
    one_sided_limit,
    saturation_gain,
)
from ibrid.measurement.formats.csv_file import read_csv, sweep_csv, write_sweep
from ibrid.measurement.quality.inspect import inspect
from ibrid.measurement.quality.inspection_table import format_inspection
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.amplitudes import at_amplitudes, joined, thinned
from ibrid.measurement.sweeps.linearity import (
    AmplitudeDependence,
    Linearity,
    linearity,
    small_signal,
)
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep

HEAD = "op,p,q,freq_hz,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im"
OP = OperatingPoint("p=1,q=0.3", 1.0, 0.3)
FREQUENCY = np.array([5.0, 20.0, 80.0, 320.0])
LEVELS = (0.004, 0.016, 0.064)
PLAIN = Nonlinearity()


# reading and writing


def row(hz: float, dd: float, *more: object, op: str = "a") -> str:
    return ",".join(map(str, (op, 1, 0, hz, dd, 0, 0, 0, 0, 0, 1, 0, *more)))


def read(tmp_path, *rows: str, columns: str = "amplitude") -> Sweep:
    file = tmp_path / "sweep.csv"
    file.write_text("\n".join([f"{HEAD},{columns}", *rows]) + "\n")
    return read_csv(file)


def test_amplitudes_of_one_frequency_are_kept_apart_the_smallest_first(tmp_path):
    rows = [
        row(hz, dd, a)
        for a, dd in ((0.016, 2.0), (0.004, 1.0), (0.064, 3.0))
        for hz in (10.0, 20.0)
    ]
    sweep = read(tmp_path, *rows)
    assert [one.points[0].admittance[0, 0, 0].real for one in at_amplitudes(sweep)] == [
        1.0,
        2.0,
        3.0,
    ]
    assert sweep.points[0].admittance[0, 0, 0] == 1.0  # what everything linear works with
    assert [np.asarray(one.points[0].amplitude)[0] for one in at_amplitudes(sweep)] == list(LEVELS)


def test_an_amplitude_that_differs_between_frequencies_is_still_one_sweep(tmp_path):
    sweep = read(tmp_path, row(10.0, 1.0, 0.01), row(20.0, 2.0, 0.002))
    assert len(at_amplitudes(sweep)) == 1
    assert linearity(sweep) is None


def test_repeats_of_one_amplitude_are_averaged_and_those_of_another_are_not(tmp_path):
    rows = [
        row(10.0, dd, run, a)
        for run, dd, a in ((1, 1.0, 0.0041), (2, 1.2, 0.0039), (1, 5.0, 0.016), (2, 5.2, 0.016))
    ]
    small, large = at_amplitudes(read(tmp_path, *rows, columns="repeat,amplitude"))
    assert small.points[0].admittance[0, 0, 0] == pytest.approx(1.1)
    assert large.points[0].admittance[0, 0, 0] == pytest.approx(5.1)
    assert small.points[0].repeats is not None
    assert small.points[0].repeats.shape[0] == 2


def test_amplitudes_numbered_as_repeats_are_apart_too(tmp_path):
    rows = [row(10.0, dd, run, a) for run, dd, a in ((1, 1.0, 0.004), (2, 5.0, 0.016))]
    assert len(at_amplitudes(read(tmp_path, *rows, columns="repeat,amplitude"))) == 2


def test_a_frequency_may_have_fewer_amplitudes_than_the_others(tmp_path):
    rows = [row(10.0, 1.0, 0.004), row(10.0, 2.0, 0.016), row(20.0, 1.0, 0.004)]
    small, large = at_amplitudes(read(tmp_path, *rows))
    assert small.points[0].frequency.tolist() == [10.0, 20.0]
    assert large.points[0].frequency.tolist() == [10.0]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([row(10.0, 1.0, 0.004), row(10.0, 2.0, 0.0041)], "number the runs in a column repeat"),
        (
            [row(10.0, 1.0, -0.004), row(10.0, 2.0, 0.016)],
            "amplitude must be positive where there are several",
        ),
        (
            [row(10.0, 1.0, 0), row(10.0, 2.0, 0.016)],
            "amplitude must be positive where there are several",
        ),
        ([row(10.0, 1.0, 0.004), row(10.0, 2.0, "")], "amplitude must be there in all rows"),
        ([row(10.0, 1.0, "large")], "amplitude"),
    ],
)
def test_amplitudes_that_mean_nothing_are_one_clear_sentence(tmp_path, rows, words):
    with pytest.raises(SweepError, match=words):
        read(tmp_path, *rows)


@pytest.mark.nightly
def test_what_is_written_at_several_amplitudes_is_read_again(tmp_path):
    sweep = device_sweep(noise_db=40.0)
    write_sweep(sweep, tmp_path / "sweep.csv")
    again = read_sweep(tmp_path / "sweep.csv")
    assert sweep_csv(again) == sweep_csv(sweep)
    assert len(at_amplitudes(again)) == 3


@pytest.mark.slow
def test_what_was_taken_apart_is_joined_again_and_a_stray_point_is_refused():
    sweep = device_sweep()
    assert sweep_csv(joined(at_amplitudes(sweep))) == sweep_csv(sweep)
    small, large = at_amplitudes(sweep)[:2]
    stray = replace(large, points=(replace(large.points[0], op=OperatingPoint("other", 0.5, 0.0)),))
    with pytest.raises(SweepError, match="other must be swept with the smallest amplitude"):
        joined([small, stray])


@pytest.mark.slow
def test_operating_points_left_out_take_their_amplitudes_along():
    one = device_sweep()
    other = replace(one.points[0], op=OperatingPoint("b", 0.5, 0.0), larger=())
    both = replace(one, points=(*one.points, other))
    assert len(at_amplitudes(both)) == 3
    assert at_amplitudes(both)[2].names == (OP.name,)
    assert len(at_amplitudes(both.without([OP.name]))) == 1


@pytest.mark.slow
def test_some_of_the_frequencies_are_chosen_at_every_amplitude():
    (point,) = device_sweep().points
    chosen = point.at(np.array([True, False, True, False]))
    assert [one.frequency.tolist() for one in (chosen, *chosen.larger)] == [
        point.frequency[::2].tolist()
    ] * len(LEVELS)
    np.testing.assert_array_equal(chosen.larger[-1].admittance, point.larger[-1].admittance[::2])
    assert chosen.amplitude is not None
    assert chosen.amplitude.shape == (2,)


@pytest.mark.slow
def test_an_amplitude_with_none_of_the_chosen_frequencies_is_gone():
    (point,) = device_sweep().points
    short = replace(point, larger=(point.larger[0], point.larger[1].at(np.array([3]))))
    assert len(short.at(np.array([0, 3])).larger) == 2
    assert len(short.at(np.array([0, 1])).larger) == 1


@pytest.mark.slow
def test_a_sweep_with_recorded_amplitudes_can_be_thinned():
    (point,) = device_sweep().points
    point = PointSweep(
        OP, np.arange(1.0, 10.0), np.resize(point.admittance, (9, 2, 2)), amplitude=np.full(9, 0.01)
    )
    (held,) = thinned(Sweep((point,)), hold=True).points
    (left,) = thinned(Sweep((point,)), hold=False).points
    assert sorted([*held.frequency, *left.frequency]) == point.frequency.tolist()
    assert held.amplitude is not None
    assert len(held.amplitude) == len(held.frequency)


# describing functions


def first_harmonic_gain(
    function, amplitude: float, bias: float = 0.0, samples: int = 4096
) -> complex:
    """The definition, by the trapezoidal rule over a period: 2/(T A) integral y(t) e^-j(t - 90 deg)
    dt; for any function.
    """
    phase = 2.0 * np.pi * (np.arange(samples) + 0.5) / samples
    y = function(bias + amplitude * np.sin(phase))
    return complex(2j * np.mean(y * np.exp(-1j * phase)) / amplitude)


def test_a_saturation_and_a_dead_zone_have_the_gain_of_their_definition():
    for amplitude in (0.3, 0.99, 1.01, 1.7, 10.0):
        clipped = first_harmonic_gain(lambda x: np.clip(x, -1.0, 1.0), amplitude)
        rest = first_harmonic_gain(lambda x: x - np.clip(x, -1.0, 1.0), amplitude)
        # the kinks cost the trapezoidal rule 1e-6
        assert saturation_gain(amplitude, 1.0) == pytest.approx(clipped.real, abs=2e-6)
        assert dead_zone_gain(amplitude, 1.0) == pytest.approx(rest.real, abs=2e-6)
        assert abs(clipped.imag) < 1e-12


def test_a_biased_limit_has_the_gain_and_the_mean_of_their_definition():
    for bias in (-0.5, 0.0, 0.4):
        for amplitude in (0.05, 0.6, 3.0):
            gain, mean = one_sided_limit(amplitude, 0.3, bias)

            def limited(t, amplitude=amplitude, bias=bias):
                return min(bias + amplitude * np.sin(t), 0.3)

            kinks = sorted(_crossings(amplitude, bias, 0.3)) or None
            expected = quad(limited, 0, 2 * np.pi, points=kinks)[0] / (2 * np.pi)
            first = quad(lambda t: limited(t) * np.sin(t), 0, 2 * np.pi, points=kinks)[0] / (
                np.pi * amplitude
            )
            assert float(mean) == pytest.approx(expected, abs=1e-9)
            assert float(gain) == pytest.approx(first, abs=1e-8)


def _crossings(amplitude: float, bias: float, limit: float) -> list[float]:
    k = (limit - bias) / amplitude
    return [float(np.arcsin(k)) % (2 * np.pi), float(np.pi - np.arcsin(k))] if abs(k) < 1 else []


def test_a_limit_whose_mean_is_held_moves_its_bias_until_the_mean_is_there():
    for amplitude in (0.5, 1.5, 8.0):
        gain = float(held_limit_gain(amplitude, 1.0))
        biases = np.linspace(0.0, amplitude + 1.0, 20001)
        found = biases[np.argmin(np.abs(one_sided_limit(amplitude, 1.0, biases)[1]))]
        assert gain == pytest.approx(float(one_sided_limit(amplitude, 1.0, found)[0]), abs=1e-3)
    assert held_limit_gain(0.9, 1.0) == pytest.approx(1.0)


# the gate


@shared
def device() -> Device:
    rng = np.random.default_rng(1)
    while True:
        found = draw_base("gfl_exact", rng)
        if stable(found, OP):
            return found


@shared
def levels(nonlinearity: Nonlinearity = PLAIN) -> tuple[Sweep, ...]:
    return tuple(
        Sweep(
            (
                PointSweep(
                    OP,
                    FREQUENCY,
                    injected(device(), nonlinearity, OP, FREQUENCY, one),
                    amplitude=np.full(4, one),
                ),
            )
        )
        for one in LEVELS
    )


def device_sweep(
    nonlinearity: Nonlinearity = PLAIN, noise_db: float | None = None, seed: int = 0
) -> Sweep:
    """A device without anything nonlinear in its controller, unless told otherwise, simulated in
    time.
    """
    sweep = joined(levels(nonlinearity))
    return (
        sweep if noise_db is None else add_noise(sweep, noise_db, rng=np.random.default_rng(seed))
    )


@pytest.mark.slow
def test_the_simulation_in_time_tends_to_the_linearised_device_at_small_amplitudes():
    linear = admittance(device(), OP, FREQUENCY, OMEGA_60)
    found = injected(device(), Nonlinearity(), OP, FREQUENCY, 1e-3)
    # amplitude squared, and two records that agree to 1e-4
    assert np.abs(found - linear).max() < 1e-5 * np.abs(linear).max()


@pytest.mark.slow
def test_what_products_change_grows_with_the_square_of_the_amplitude():
    linear = admittance(device(), OP, FREQUENCY[:1], OMEGA_60)
    middle, large = (
        np.linalg.norm(one.points[0].admittance[0] - linear[0]) for one in levels()[1:]
    )
    assert large / middle == pytest.approx(16.0, rel=0.02)
    assert large < 0.064**2 * np.linalg.norm(linear)


def test_a_device_with_a_delay_is_refused_by_the_simulation_in_time():
    for late in ({"T_d": 1e-4}, {"T_hold": 1e-4}, {"T_current": 1e-4}):
        with pytest.raises(IbridError, match="must have no delay"):
            injected(replace(device(), **late), Nonlinearity(), OP, FREQUENCY, 1e-3)


@pytest.mark.slow
@each_of("seed", range(20))
def test_the_gate_is_silent_on_a_linear_device_at_small_amplitudes(seed):
    small = joined(at_amplitudes(device_sweep())[:2])
    found = linearity(add_noise(small, 60.0, rng=np.random.default_rng(seed)))
    assert found is not None
    assert found.bands == ()
    assert len(found.refused) == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_what_products_of_signals_change_is_told_and_refuses_nothing(seed):
    sweep = device_sweep(noise_db=70.0, seed=seed)
    found = linearity(sweep)
    assert found is not None
    assert found.bands
    assert all(one.products for one in found.bands)
    assert len(found.refused) == 0
    kept = small_signal(sweep, found)
    assert kept is not None
    assert kept.points[0].frequency.tolist() == FREQUENCY.tolist()
    # what they may add at the smallest amplitude counts as noise
    assert (np.asarray(kept.points[0].sigma) > np.asarray(sweep.points[0].sigma)).all()


def test_the_sentence_says_where_as_an_engineer_writes_frequencies():
    def told(refused: list[float]) -> str:
        part = AmplitudeDependence(
            OP.name, (5.0, 5000.0), "qq", 9.0, 0.2, (0.004, 0.064), products=False
        )
        return Linearity((0.004, 0.064), (part,), np.array(refused), "", 1).sentence

    assert "depends on them from 5 Hz to 5 kHz;" in told([5.0, 100.0, 5000.0])
    assert "depends on them at 19.9 Hz;" in told([19.91, 19.93])
    assert "changes with them from 5 Hz to 5 kHz, no more" in told([])


@pytest.mark.slow
@pytest.mark.parametrize("noise_db", [None, 60.0, 40.0])
def test_a_dead_zone_is_refused_where_the_pll_acts_and_not_above(noise_db):
    found = linearity(device_sweep(Nonlinearity(deadband=0.002), noise_db))
    assert found is not None
    assert {5.0, 20.0} <= set(found.refused.tolist())
    assert found.bands[0].entry in ("dq", "qq")  # the column of v_q, which the PLL follows
    assert found.bands[0].change > 0.1
    assert not found.bands[0].products


@pytest.mark.slow
def test_the_gate_does_not_look_at_one_amplitude():
    assert linearity(at_amplitudes(device_sweep())[0]) is None


@pytest.mark.slow
def test_the_false_alarms_of_the_gate_are_rare():
    rng = np.random.default_rng(5)
    clean = at_amplitudes(device_sweep())[0].points[0]
    same = joined([Sweep((replace(clean, amplitude=np.full(4, one)),)) for one in LEVELS])
    found = [linearity(add_noise(same, 40.0, rng=rng)) for _ in range(200)]
    alarms = sum(one is not None and len(one.bands) > 0 for one in found)
    assert None not in found
    assert alarms <= 2  # 0.2 are expected; more than two in 200 happen once in a thousand


@pytest.mark.nightly
def test_the_first_look_says_that_the_response_depends_on_the_amplitude():
    look = inspect(device_sweep(Nonlinearity(deadband=0.002), 60.0))
    assert look.points[0].amplitudes == LEVELS
    assert any("no small-signal model holds" in one for one in look.warnings)
    assert "0.004, 0.016, 0.064" in format_inspection(look)
    assert not any(
        "Swept with" in one for one in inspect(at_amplitudes(device_sweep())[0]).warnings
    )
