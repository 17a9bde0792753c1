"""Participation factors, modes and how they move: closed forms and finite differences."""

import numpy as np
import pytest

from ibrid.analysis.models.modes import least_damped, modes, participation, pole_slopes, rightmost

OMEGA_0 = 2 * np.pi * 50


def random_matrix(seed: int, n: int = 6) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((n, n))


def test_a_two_by_two_matrix_has_the_factors_of_its_closed_form():
    a, b, c, d = -3.0, 2.0, 1.0, -1.0
    found = participation(np.array([[a, b], [c, d]]), ("one", "two"))
    for mode, pole in enumerate(found.poles):
        other = found.poles[1 - mode]
        # p_11 = (lambda - d) / (lambda - lambda'), from the eigenvectors (lambda - d, c) and
        # (lambda - d, b)
        assert found.factors[0, mode] == pytest.approx((pole - d) / (pole - other), rel=1e-12)


def test_both_currents_of_an_rl_circuit_share_its_mode_equally():
    r, x = 0.02, 0.3
    A = np.array([[-r / x, 1.0], [-1.0, -r / x]]) * OMEGA_0
    upper, *_ = modes(A, ("line.i_d", "line.i_q"))
    assert upper.pole == pytest.approx(complex(-r / x, 1.0) * OMEGA_0, rel=1e-12)
    assert dict(upper.states) == pytest.approx({"line.i_d": 0.5, "line.i_q": 0.5})
    assert upper.damping == pytest.approx((r / x) / np.hypot(r / x, 1.0))
    assert upper.frequency == pytest.approx(50.0)


def test_factors_of_every_state_and_of_every_mode_sum_to_one():
    found = participation(random_matrix(1), [*"abcdef"])
    np.testing.assert_allclose(found.factors.sum(axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose(found.factors.sum(axis=1), 1.0, atol=1e-12)


def test_factors_do_not_depend_on_the_units_of_the_states():
    A, scale = random_matrix(2), np.diag(10.0 ** np.arange(-3, 3))
    first, second = (
        participation(A, [*"abcdef"]),
        participation(scale @ A @ np.linalg.inv(scale), [*"abcdef"]),
    )
    order = [int(np.argmin(np.abs(second.poles - pole))) for pole in first.poles]
    np.testing.assert_allclose(second.factors[:, order], first.factors, atol=1e-9)


def test_a_factor_is_the_change_of_the_pole_by_the_diagonal_entry():
    A, step = random_matrix(3), 1e-6
    found = participation(A, [*"abcdef"])
    for state in range(6):
        change = np.zeros((6, 6))
        change[state, state] = step
        poles = np.linalg.eigvals(A + change)
        moved = np.array([poles[np.argmin(np.abs(poles - pole))] for pole in found.poles])
        np.testing.assert_allclose(
            (moved - found.poles) / step, found.factors[state], atol=1e-4
        )  # second order in step


def test_pole_slopes_are_those_of_finite_differences():
    A, direction, step = random_matrix(4), random_matrix(5), 1e-6
    poles = participation(A, [*"abcdef"]).poles
    above, below = np.linalg.eigvals(A + step * direction), np.linalg.eigvals(A - step * direction)
    (slopes,) = pole_slopes(A, [direction])
    for pole, slope in zip(poles, slopes, strict=True):
        ends = [found[np.argmin(np.abs(found - pole))] for found in (above, below)]
        assert slope == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)


def test_deviations_of_a_mode_follow_those_of_its_matrix():
    sigma, omega = -2.0, 40.0
    A = np.array([[sigma, omega], [-omega, sigma]])
    (mode,) = modes(A, ("one", "two"), [0.1 * np.eye(2), np.array([[0.0, 0.5], [-0.5, 0.0]])])
    assert mode.real_deviation == pytest.approx(0.1)
    assert mode.imag_deviation == pytest.approx(0.5)
    size = np.hypot(sigma, omega)
    by_real, by_imag = -(omega**2) / size**3 * 0.1, sigma * omega / size**3 * 0.5  # of -sigma / |p|
    assert mode.damping_deviation == pytest.approx(np.hypot(by_real, by_imag))


def test_modes_are_sorted_and_overdamped_pairs_do_not_count_as_oscillations():
    A = np.zeros((5, 5))
    A[:2, :2] = [[-1.0, 100.0], [-100.0, -1.0]]
    A[2:4, 2:4] = [[-50.0, 1.0], [-1.0, -50.0]]
    A[4, 4] = 0.5
    found = modes(A, [*"abcde"])
    assert [one.pole.real for one in found] == pytest.approx([0.5, -1.0, -50.0])
    assert [one.stable for one in found] == [False, True, True]
    assert [one.pole for one in least_damped(found)] == pytest.approx([complex(-1, 100)])
    assert rightmost(A) == pytest.approx(0.5)


def test_a_system_without_states_has_no_modes():
    assert modes(np.zeros((0, 0)), ()) == ()
    assert rightmost(np.zeros((0, 0))).real == -np.inf
