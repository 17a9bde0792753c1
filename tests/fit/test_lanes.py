"""Fits take several frequencies at once; each has the answer that it has by itself."""

import numpy as np
import pytest

from ibrid.assembly.symbolic import symbolic_model
from ibrid.fit import kernel
from ibrid.fit.just_in_time import njit
from ibrid.fit.lane_response import plan_elimination
from ibrid.fit.lanes import (
    LANES,
    WIDTH,
    add_scaled_matrix,
    copy,
    dot_matrices,
    invert,
    magnitude,
    multiply,
    negate,
    put,
    subtract_product,
)
from ibrid.fit.problem import Problem
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.reading.wiring import wire

OP = OperatingPoint("p=0.8,q=0.1", 0.8, 0.1)


@njit
def operate(numbers):
    """Every operation, of numbers 0 and 1 into those from 8 on; matrices at 0 and 4."""
    multiply(numbers, 8 * WIDTH, 0, WIDTH)
    copy(numbers, 9 * WIDTH, 0)
    subtract_product(numbers, 9 * WIDTH, 0, WIDTH)
    copy(numbers, 10 * WIDTH, WIDTH)
    invert(numbers, 10 * WIDTH)
    copy(numbers, 11 * WIDTH, WIDTH)
    negate(numbers, 11 * WIDTH)
    put(numbers, 12 * WIDTH, 2.5)
    for place in range(13, 17):
        put(numbers, place * WIDTH, 1.0)
    add_scaled_matrix(numbers, 13 * WIDTH, 0, -3.0)
    return magnitude(numbers, 0), dot_matrices(numbers, 0, 4 * WIDTH)


def test_operations_in_lanes_are_those_of_complex_numbers():
    numbers = np.random.default_rng(1).normal(size=20 * WIDTH)
    size, dot = operate(numbers)
    values = numbers.reshape(20, 2, LANES)
    a = values[:, 0] + 1j * values[:, 1]
    wanted = [a[0] * a[1], a[0] - a[0] * a[1], 1 / a[1], -a[1], np.full(LANES, 2.5)]
    np.testing.assert_allclose(a[8:13], wanted, rtol=1e-14)
    np.testing.assert_allclose(a[13:17], 1 - 3 * a[:4], rtol=1e-14, atol=1e-14)
    assert size == pytest.approx(np.abs(values[0]).sum(), rel=1e-14)
    assert dot == pytest.approx((values[:4] * values[4:8]).sum(), rel=1e-12)


def problem_of(name: str, number: int, excited: bool = False) -> Problem:
    """A diagram and data that it does not fit; `excited` : by unit matrices, which change
    nothing.
    """
    model = symbolic_model(
        wire(textbook(name), VOCABULARY),
        equilibrium="exact",
        power_node="capacitor",
        omega_0=2 * np.pi * 50,
    )
    frequency = np.geomspace(3.0, 4000.0, number)
    rng = np.random.default_rng(number)
    measured = rng.normal(size=(number, 2, 2)) + 1j * rng.normal(size=(number, 2, 2))
    excitation = np.tile(np.eye(2, dtype=complex), (number, 1, 1)) if excited else None
    return Problem(model, [PointSweep(OP, frequency, measured, excitation=excitation)])


@pytest.mark.parametrize("objective", ["nrmse", "log"])
@pytest.mark.parametrize("name", ["gfl_delay", "gfm_vsm", "gfl_sampled"])
def test_frequencies_at_once_have_the_answers_that_they_have_one_by_one(name: str, objective: str):
    """An excitation by unit matrices is taken one by one, with pivots of its own."""
    for number in (1, LANES - 1, LANES, 2 * LANES + 3):
        together, alone = problem_of(name, number), problem_of(name, number, excited=True)
        x = np.random.default_rng(2).normal(size=(3, together.size))
        first, second = (
            one.normal_equations(x, objective, with_slopes=True) for one in (together, alone)
        )
        usable = np.isfinite(second.cost).all(axis=1)
        assert usable.any()
        np.testing.assert_array_equal(np.isfinite(first.cost), np.isfinite(second.cost))
        np.testing.assert_allclose(first.cost[usable], second.cost[usable], rtol=1e-8)
        for one, equations in ((together, first), (alone, second)):
            costs = one.costs(x, objective)
            np.testing.assert_allclose(costs[usable], equations.cost[usable], rtol=1e-9)
        for start in np.flatnonzero(usable):
            for one, other in ((first.gradient, second.gradient), (first.hessian, second.hessian)):
                scale = np.abs(other[start]).max()
                np.testing.assert_allclose(one[start], other[start], atol=1e-7 * scale)
            slope, scale = first.slopes[start][0]
            np.testing.assert_allclose(
                (slope @ first.residuals[0][start]) * scale,
                first.gradient[start, 0],
                atol=1e-9 * np.abs(first.gradient[start]).max(),
            )


def test_a_frequency_whose_pivot_vanishes_alone_is_solved_with_pivots_of_its_own():
    """K = [[s, 1], [1, s]]: at s = 0 the diagonal is zero, and its rows exchange."""
    rows, columns = np.array([0, 1, 0, 1, 0, 2]), np.array([1, 0, 0, 1, 2, 0])
    line = 1j * np.linspace(0.0, 0.7, LANES)
    values = np.array([[-1.0, -1.0, 0.0, 0.0, 1.0, 1.0]])
    none = np.array([], dtype=np.int64)
    data = np.ones((LANES, 2, 2), dtype=complex)
    data.flags.writeable = False
    found = kernel.normal_equations(
        values,
        np.zeros((1, 0)),
        rows,
        columns,
        none,
        none,
        np.full(2, -1),
        -np.ones((1, 2)),
        line,
        kernel.excited(None, line),
        data,
        np.ones((LANES, 2, 2)),
        False,
        2,
        0,
        False,
        np.full(1, np.inf),
        False,
        plan_elimination(rows, columns, none, 2),
    )
    y_dd = line / (line**2 - 1)
    others = 3 * LANES  # which are not coupled: 1 each
    assert found[0][0] == pytest.approx((np.abs(y_dd - 1) ** 2).sum() + others, rel=1e-12)
