"""The near twin of a cascade that damps with the fast part of the voltage: two slow corners
exchanged.
"""

import numpy as np
import pytest

import ibrid
from ibrid.assembly.symbolic import symbolic_model
from ibrid.fit.problem import Problem
from ibrid.fit.twins import CornerSwap, find_twins
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants import PLANTS
from ibrid.structure.reading.wiring import wire

FORMING = ("gfm_droop", "gfm_vsm", "gfm_dvoc", "parallel_gfl_gfm")


def case(name: str) -> tuple[Problem, tuple[CornerSwap, ...], dict[str, float]]:
    sweep, plant = ibrid.read_sweep(ibrid.benchmarks()[name]), PLANTS[name]
    wiring = wire(ibrid.parse_program(plant.program), VOCABULARY)
    model = symbolic_model(
        wiring, equilibrium="exact", power_node=sweep.power_node, omega_0=sweep.omega_0
    )
    problem = Problem(model, sweep.points)
    return problem, find_twins(problem, wiring, sweep.omega_0).corners, dict(plant.diagram_values)


def error(problem: Problem, theta: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference of two responses, relative to the norm at each frequency."""
    pairs = zip(
        *(problem.responses(problem.coordinates.to_x(one)) for one in (theta, wanted)), strict=True
    )
    return max(
        float((np.linalg.norm(a - b, axis=(1, 2)) / np.linalg.norm(b, axis=(1, 2))).max())
        for a, b in pairs
    )


@pytest.mark.parametrize("name", FORMING)
def test_the_corner_of_the_damping_and_that_of_the_current_control_are_exchanged(name):
    problem, (swap,), values = case(name)
    names = [one.name for one in problem.numbers]
    theta = np.array([values[one] for one in names])
    other = swap.apply(theta)
    # L s^2 + (R + kP) s + kI has the roots -a and -b: the twin has -a and -omega_c
    (at_l, at_r), (at_p, at_i), (_, at_c) = swap.filter, swap.inner, swap.damping
    omega_0 = swap.omega_0

    def roots(of: np.ndarray) -> np.ndarray:
        return np.sort(-np.roots([of[at_l] / omega_0, of[at_r] + of[at_p], of[at_i]]))

    slow, fast = roots(theta)
    np.testing.assert_allclose(roots(other), [theta[at_c], fast], rtol=1e-9)
    assert other[at_c] == pytest.approx(slow)
    np.testing.assert_allclose(swap.apply(other), theta, rtol=1e-9)  # twice is nothing
    untouched = [k for k in range(len(names)) if k not in swap.entries]
    np.testing.assert_array_equal(other[untouched], theta[untouched])


def test_no_data_tell_the_twins_of_a_controller_apart_that_cancels_the_pole_of_its_filter():
    problem, (swap,), values = case("gfm_droop")

    def apart(part: float) -> float:
        values["plant.R_F"] = (
            part
            * values["plant.L_F"]
            * values["current.kI"]
            / (swap.omega_0 * values["current.kP"])
        )
        theta = np.array([values[one.name] for one in problem.numbers])
        return error(problem, swap.apply(theta), theta)

    assert apart(1.0) < 1e-9  # rounding of the solves
    assert 1e-5 < apart(1.1) < 1e-2


@pytest.mark.parametrize("name", ["paper_like", "gfl_l_filter", "gfl_dc_link", "hybrid_gfl_gfm"])
def test_inverters_without_such_a_damping_have_none(name):
    assert case(name)[1] == ()


def test_a_loop_without_a_slow_real_corner_has_no_twin_in_the_boxes():
    problem, (swap,), values = case("gfm_droop")
    values["current.kI"] = 1e5  # the two roots are complex
    other = swap.apply(np.array([values[one.name] for one in problem.numbers]))
    assert not np.all(other >= problem.coordinates.low)
