"""Conventions: correct data pass, one wrong declaration is named, and what cannot be decided is not
guessed.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.recipes import recipes

from ibrid.measurement import (
    OperatingPoint,
    PointSweep,
    Sweep,
    add_noise,
    check_conventions,
    hardware_sweeps,
    read_sweep,
)
from ibrid.measurement.conventions.angle_law import angle_reading
from ibrid.measurement.conventions.resting_axis import resting_axis
from ibrid.measurement.conventions.tail import inductive_tail
from ibrid.measurement.quality.plausibility import implausible_numbers
from ibrid.measurement.sweeps.noise import estimate, estimate_point
from ibrid.plants.equilibrium import capacitor_voltage
from ibrid.plants.output_filter import FilterParameters
from ibrid.plants.published import PLANTS
from ibrid.plants.sweeping import sweep as sweep_of

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "data").glob("*.csv"))
T = np.diag([1.0, -1.0])
J = np.array([[0.0, -1.0], [1.0, 0.0]])
POINTS = ((1.0, 0.3), (0.6, -0.3), (-0.8, 0.1))
LOW = np.geomspace(0.05, 5000, 80)


def inverter(
    frequency: np.ndarray, p: float, q: float, *, delay: float = 1e-4, power: float = 20.0
) -> np.ndarray:
    """Y of an L-filter inverter with PLL, PI current control, feedforward, delay and PI power
    control, at v = 1.
    """
    i_0, u_0 = np.array([p, -q]), np.array([1.0, 0.0]) + (0.005 * np.eye(2) + 0.15 * J) @ [p, -q]
    result = []
    for s in 2j * np.pi * frequency:
        impedance = (0.005 + s * 0.15 / (120 * np.pi)) * np.eye(2) + 0.15 * J
        angle = np.array([0, (60 + 1400 / s) / (s + 60 + 1400 / s)])
        v_local, i_angle, u_angle = (
            np.eye(2) - np.outer(J @ [1, 0], angle),
            np.outer(J @ i_0, angle),
            np.outer(J @ u_0, angle),
        )
        pq_i, pq_v = np.diag([1.0, -1.0]), np.array([[p, -q], [q, p]])
        outer = (0.02 + power / s) * np.diag([-1.0, 1.0])
        current = (0.5 + 10 / s) * np.exp(-s * delay)
        from_i = current * (outer @ pq_i - np.eye(2)) + np.exp(-s * delay) * 0.15 * J
        from_v = current * outer @ pq_v + np.exp(-s * delay) * np.eye(2)
        # u = from_i (i - i_angle v) + from_v v_local v + u_angle v and u - v = impedance i
        right = -from_i @ i_angle + from_v @ v_local + u_angle - np.eye(2)
        result.append(np.linalg.solve(impedance - from_i, right))
    return np.array(result)


def measured(
    wrong=lambda values: values,
    declared=lambda p, q: (p, q),
    points=POINTS,
    frequency=LOW,
    **options,
) -> Sweep:
    return Sweep(
        tuple(
            PointSweep(
                OperatingPoint(f"p={p},q={q}", *declared(p, q)),
                frequency,
                wrong(inverter(frequency, p, q, **options)),
            )
            for p, q in points
        )
    )


def rescaled(sweep: Sweep, factor: float) -> Sweep:
    return replace(
        sweep,
        points=tuple(replace(point, frequency=factor * point.frequency) for point in sweep.points),
    )


def test_the_law_that_the_test_rests_on_holds():
    for p, q in POINTS:
        np.testing.assert_allclose(
            inverter(np.array([1e-5]), p, q)[0], -np.array([[p, -q], [-q, -p]]), atol=1e-5
        )


@each_of("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_sweeps_raise_no_doubt(path):
    sweep = read_sweep(path)
    assert check_conventions(sweep).status != "doubt"
    assert implausible_numbers(sweep) == ()


@pytest.mark.parametrize("path", hardware_sweeps().values(), ids=lambda path: path.stem)
def test_hardware_raises_no_doubt_and_shows_the_direction_of_the_current(path):
    sweep = read_sweep(path)
    assert check_conventions(sweep).status == "agree"
    assert implausible_numbers(sweep) == ()
    verdict = check_conventions(read_sweep(path, current="out"))
    assert verdict.status == "doubt"
    assert "the current is probably counted the other way" in verdict.warnings[0]


def test_correct_data_agree():
    verdict = check_conventions(measured())
    assert verdict.status == "agree"
    assert verdict.warnings == ()


@pytest.mark.nightly
@each_of("start", [0.1, 0.5, 2.0, 5.0, 20.0])
@each_of("power", [0.5, 5.0, 50.0])
def test_correct_data_raise_no_doubt_however_slow_the_power_loops(start, power):
    assert (
        check_conventions(measured(frequency=np.geomspace(start, 5000, 24), power=power)).status
        != "doubt"
    )


MISTAKES = {
    "current": (lambda Y: -Y, lambda p, q: (p, q), "current is counted the other way"),
    "q axis": (lambda Y: T @ Y @ T, lambda p, q: (p, q), "the q axis points the other way"),
    "sign of q": (lambda Y: Y, lambda p, q: (p, -q), "the sign of q is reversed"),
    "p consumed": (lambda Y: Y, lambda p, q: (-p, q), "p is what the inverter consumes"),
    "p and q consumed": (
        lambda Y: Y,
        lambda p, q: (-p, -q),
        "p and q are what the inverter consumes",
    ),
    "d and q exchanged": (lambda Y: Y[:, ::-1, ::-1], lambda p, q: (p, q), "d and q are exchanged"),
    "voltage on q": (lambda Y: J @ Y @ J.T, lambda p, q: (p, q), "the voltage at rest"),
    "current and q axis": (
        lambda Y: -(T @ Y @ T),
        lambda p, q: (p, q),
        "current and q axis are both declared",
    ),
    "three phases": (lambda Y: 3 * Y, lambda p, q: (p, q), "three times too small"),
    "siemens": (lambda Y: Y / 428, lambda p, q: (p, q), "the unit or the base"),
}


@pytest.mark.slow
@each_of("name", MISTAKES)
@each_of("noise_db", [None, 40, 20])
def test_a_wrong_declaration_is_named(name, noise_db):
    wrong, declared, sentence = MISTAKES[name]
    sweep = measured(wrong, declared)
    if noise_db is not None:
        sweep = add_noise(sweep, noise_db, rng=np.random.default_rng(0), record_sigma=False)
    verdict = check_conventions(sweep)
    assert verdict.status == "doubt"
    assert sentence in verdict.warnings[0]


def test_unsettled_low_end_gives_no_verdict():
    # at 5 Hz integral power control of 2 rad/s still moves; the delayed feedforward hides the
    # inductance
    sweep = measured(lambda Y: T @ Y @ T, frequency=np.geomspace(5, 5000, 16), power=2.0)
    assert check_conventions(sweep).status == "undecided"


@each_of("noise_db", [None, 60, 40])
def test_the_axis_of_the_voltage_is_seen_before_the_power_loops_settle(noise_db):
    turned = {
        "": J,
        " and # q_axis: lags (leads where it says lags) if q is": np.array(
            [[0.0, 1.0], [1.0, 0.0]]
        ),
    }
    for words, turn in turned.items():
        sweep = measured(
            lambda Y, turn=turn: -turn @ Y @ turn.T,
            frequency=np.geomspace(0.5, 900, 40),
            power=2.0,
        )
        sweep = (
            sweep if noise_db is None else add_noise(sweep, noise_db, rng=np.random.default_rng(3))
        )
        (said,) = check_conventions(sweep).warnings
        current = "# current: in (out where it says in) if p is what the inverter delivers"
        assert said.endswith(f"write # voltage_axis: q (d where it says q) and {current}{words}.")


def test_the_axis_of_the_voltage_of_correct_data_is_never_taken_for_q():
    for benchmark in recipes():
        for lowest in (0.2, 2.0, 7.0):
            sweep = sweep_of(benchmark.plant, None, np.geomspace(lowest, 5000, 24), noise_db=50)
            seen = resting_axis(sweep, estimate(sweep))
            assert seen is None or (seen.axis, seen.sign) == ("d", 1), (benchmark.name, lowest)


ROOT_2 = 2**0.5


def frame_turned(Y: np.ndarray, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, s], [-s, c]])
    return turn @ Y @ turn.T


UNSETTLED_POWER = {
    "p and q, peak as rms": (lambda Y: Y, ROOT_2, "peak and rms values confused (sqrt 2)"),
    "p and q, rms as peak": (lambda Y: Y, 1 / ROOT_2, "peak and rms values confused (sqrt 2)"),
    "p and q, line and phase": (lambda Y: Y, 3**0.5, "line and phase values confused (sqrt 3)"),
    "base": (lambda Y: 1.5 * Y, 1.0, "the factor 3/2 of the Park transformation"),
    "transformations": (
        lambda Y: 1.5**0.5 * Y,
        1.0,
        "two Park transformations, with 2/3 and with sqrt(2/3)",
    ),
    "q axis": (lambda Y: T @ Y @ T, 1.0, "the q axis points the other way"),
    "current": (lambda Y: -Y, 1.0, "the current is counted the other way"),
    "frame": (lambda Y: frame_turned(Y, -15), 1.0, "the measuring frame is turned by about -1"),
}


@pytest.mark.nightly
@each_of("name", UNSETTLED_POWER)
@each_of("noise_db", [None, 60, 40])
def test_the_angle_tells_what_power_loops_that_have_not_settled_do_not(name, noise_db):
    wrong, factor, sentence = UNSETTLED_POWER[name]
    powers = [(1.0, 0.3), (0.6, -0.3), (0.8, 0.1)]
    sweep = measured(
        wrong, lambda p, q: (factor * p, factor * q), powers, np.geomspace(0.5, 5000, 40), power=2.0
    )
    sweep = replace(sweep, power_node="pcc")
    sweep = sweep if noise_db is None else add_noise(sweep, noise_db, rng=np.random.default_rng(1))
    assert sentence in check_conventions(sweep).warnings[0]


def test_the_second_column_of_an_inverter_at_rest_reads_p_and_q_with_any_kind_of_control():
    for benchmark in recipes():
        slow = sweep_of(benchmark.plant, None, np.geomspace(1e-4, 1e-3, 8))
        for point in slow.points:
            reading = angle_reading(point, estimate_point(point))
            power = complex(point.op.p, point.op.q)
            if slow.power_node == "capacitor":  # what the grid-side inductor takes lies between
                own = cast(FilterParameters, benchmark.plant.parameters)
                current = abs(power) / capacitor_voltage(own, point.op)
                power -= (own.R_g + 1j * own.L_g) * current**2
            assert reading is not None, benchmark.name
            assert abs(reading.power - power) < 1e-4, (benchmark.name, reading.power, power)


@pytest.mark.nightly
@each_of("noise_db", [None, 60, 40, 26])
def test_correct_sweeps_of_every_inverter_raise_no_doubt_from_two_hertz_on(noise_db):
    for benchmark in recipes():
        for lowest in (0.2, 2.0, 7.0):
            sweep = sweep_of(
                benchmark.plant, None, np.geomspace(lowest, 5000, 24), noise_db=noise_db
            )
            assert check_conventions(sweep).warnings == (), (benchmark.name, lowest)


def test_one_point_at_which_a_droop_absorbs_power_and_has_not_settled_raises_no_doubt():
    doubted = []
    for name, p, lowest in (
        ("gfm_droop", -0.5, 5.0),
        ("gfm_droop", -1.0, 7.0),
        ("hybrid_gfl_gfm", -1.0, 7.0),
    ):
        sweep = sweep_of(
            PLANTS[name], [OperatingPoint("absorbing", p, 0.1)], np.geomspace(lowest, 2500.0, 20)
        )
        doubted += (
            [(name, p, *check_conventions(sweep).warnings)]
            if check_conventions(sweep).warnings
            else []
        )
    assert not doubted


@pytest.mark.slow
def test_a_point_whose_p_or_q_belongs_to_another_is_named_and_p_and_q_exchanged_everywhere_are():
    powers = [(1.0, 0.3), (0.6, -0.3), (0.8, 0.1)]
    wrong = {(1.0, 0.3): (0.5, 0.3), (0.6, -0.3): (0.6, 0.3)}
    for noise_db in (None, 60, 40):
        for odd, labelled in wrong.items():
            sweep = measured(
                lambda Y: Y,
                lambda p, q, odd=odd, labelled=labelled: labelled if (p, q) == odd else (p, q),
                powers,
            )
            sweep = (
                sweep
                if noise_db is None
                else add_noise(sweep, noise_db, rng=np.random.default_rng(2))
            )
            (said,) = check_conventions(sweep).warnings
            shown = [
                float(number) for number in re.findall(r"show p = (\S+), q = (\S+) at ", said)[0]
            ]
            assert np.allclose(shown, odd, atol=0.02)
            assert "this one is probably wrong" in said
        exchanged = measured(lambda Y: Y, lambda p, q: (q, p), powers)
        assert "they are probably exchanged" in check_conventions(exchanged).warnings[0]


def test_one_point_that_disagrees_forbids_a_verdict():
    good, bad = measured(), measured(lambda Y: T @ Y @ T)
    assert (
        check_conventions(replace(good, points=(*bad.points[:2], good.points[2]))).status != "doubt"
    )


def test_without_q_the_q_axis_is_said_to_be_untested():
    verdict = check_conventions(measured(lambda Y: T @ Y @ T, points=((1.0, 0.0), (0.5, 0.0))))
    assert verdict.status == "agree"
    assert "q is too small to test the q axis" in verdict.sentence


def test_an_idle_inverter_says_nothing():
    sweep = measured(lambda Y: -Y, points=((0.0, 0.0),))
    assert check_conventions(sweep).status == "undecided"
    assert implausible_numbers(sweep) == ()


def test_a_single_frequency_gives_no_verdict():
    sweep = measured(frequency=np.array([50.0]))
    assert check_conventions(sweep).status == "undecided"
    assert implausible_numbers(sweep) == ()


def inductance(frequency: np.ndarray) -> Sweep:
    values = np.linalg.inv(-(1j * frequency / 60 * 0.2)[:, None, None] * np.eye(2) - 0.2 * J)
    return Sweep((PointSweep(OperatingPoint("a", 1, 0), frequency, values),))


def test_an_inductive_tail_is_recognised_with_its_reactance():
    point = inductance(np.geomspace(100, 5000, 30)).points[0]
    tail = inductive_tail(point, 60.0)
    assert tail is not None
    assert tail.direction == 1
    assert tail.reactance == pytest.approx(0.2, rel=0.01)


def test_frequencies_in_rad_per_second_or_khz_are_noticed():
    assert (
        "rad/s"
        in implausible_numbers(rescaled(measured(frequency=np.geomspace(5, 5000, 30)), 2 * np.pi))[
            0
        ]
    )
    assert "kHz" in implausible_numbers(rescaled(inductance(np.geomspace(100, 5000, 30)), 1e-3))[0]
    assert implausible_numbers(inductance(np.geomspace(100, 5000, 30))) == ()


@pytest.mark.parametrize(("factor", "word"), [(1 / 428, "smaller"), (1e4, "larger")])
def test_admittances_far_from_per_unit_are_noticed(factor, word):
    assert (
        word
        in implausible_numbers(measured(lambda Y: factor * Y, frequency=np.geomspace(5, 5000, 30)))[
            0
        ]
    )


def test_points_above_half_the_sampling_rate_are_counted():
    sweep = inductance(np.array([1000.0, 4000.0, 6000.0]))
    assert implausible_numbers(sweep, 10e3)[0].startswith(
        "1 point lies above half the sampling rate (5000 Hz)"
    )
    assert implausible_numbers(replace(sweep, sampling_hz=6e3))[0].startswith("2 points lie")
