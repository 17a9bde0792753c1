"""What a fit does at its limits: of waves, of Pade forms, and of data that contradict
themselves.
"""

from dataclasses import replace

import numpy as np
import pytest
from fitted import benchmark

import ibrid
from ibrid.assembly.symbolic import symbolic_model
from ibrid.fit.multistart import LocalMinimum, MultistartSearch, fit
from ibrid.fit.problem import Problem
from ibrid.fit.settings import FitSettings
from ibrid.fit.starts import StartDrawer
from ibrid.fit.twins import find_twins, twins_of
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep
from ibrid.modules.delay import PHASE_TOLERANCE, pade_limit, pade_state_space
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants import PLANTS
from ibrid.structure.reading.wiring import wire


def problem_of(name: str):
    sweep = benchmark()
    wiring = wire(ibrid.textbook(name), VOCABULARY)
    model = symbolic_model(
        wiring, equilibrium="exact", power_node="capacitor", omega_0=sweep.omega_0
    )
    problem = Problem(model, sweep.points)
    return (
        problem,
        StartDrawer(problem, wiring, sweep.omega_0),
        find_twins(problem, wiring, sweep.omega_0),
    )


@pytest.mark.slow
def test_hops_follow_even_when_no_wave_has_settled():
    problem, drawer, twins = problem_of("gfl_l_filter")
    solution = fit(
        problem, drawer, twins, np.random.default_rng(0), FitSettings(restarts=0, hops=1)
    )
    assert solution is not None
    assert solution.waves == 1
    assert (
        len(solution.finished) > solution.independent
    )  # what hops and twins derived is counted apart


@pytest.mark.slow
def test_ends_derived_from_the_best_answer_do_not_count_as_agreement():
    problem, drawer, twins = problem_of("gfl_l_filter")
    search = MultistartSearch(problem, drawer, twins, np.random.default_rng(0), FitSettings(hops=1))
    search.run_wave(0)
    search.hop()
    assert all(one.wave == 0 for one in search.agreeing)
    assert not search.has_converged  # one wave proves nothing


def test_a_twin_is_found_whatever_scale_the_best_answer_happens_to_have():
    problem, drawer, twins = problem_of("gfl_pll_filter_exact")
    search = MultistartSearch(problem, drawer, twins, np.random.default_rng(0), FitSettings())
    values = dict(PLANTS["paper_like"].diagram_values)
    for name in (
        "plant.L_F",
        "plant.R_F",
        "current.kP",
        "current.kI",
        "decoupling.L",
    ):  # which scale together
        values[name] *= 5.0
    x = problem.coordinates.to_x(np.array([values[one.parameter.name] for one in problem.numbers]))
    assert problem.costs(x[None], "nrmse").max() < 1e-20
    (beside,) = twins_of(
        problem.coordinates, search.swaps, x
    )  # the twin of this scale has a resistance above its box
    assert problem.costs(beside[None], "nrmse").max() > 1e-6
    search.finished.append(LocalMinimum(x, 0.0, 0))
    best, twins = search.most_plausible()
    assert len(twins) == 1
    assert problem.costs(np.array([best, *twins]), "nrmse").max() < 1e-16
    assert best[search.swaps[0].resistance] < twins[0][search.swaps[0].resistance]


def test_a_pade_form_holds_up_to_its_limit_and_not_above():
    delay, order = 5e-4, 12
    a, b, c, d = (np.array(rows) for rows in pade_state_space(delay, order))
    limit = pade_limit(delay, order)
    for factor, holds in ((0.98, True), (1.02, False)):
        s = 2j * np.pi * limit * factor
        response = (c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d)[0, 0]
        error = abs(np.angle(response * np.exp(s * delay)))
        assert (error <= PHASE_TOLERANCE) == holds


def long_delay_sweep() -> ibrid.Sweep:
    sweep = benchmark()
    points = tuple(
        PointSweep(point.op, np.geomspace(5.0, 2e4, 16), point.admittance) for point in sweep.points
    )
    return replace(sweep, points=points)


@pytest.mark.slow
def test_a_delay_beyond_its_pade_form_is_said_in_a_warning():
    text = ibrid.program_text(ibrid.textbook("gfl_delay")).replace(
        '"delay")', '"delay", T_d=0.0005)'
    )
    record = ibrid.evaluate(ibrid.parse_program(text), long_delay_sweep(), restarts=0)
    assert any("Pade form of order 12" in warning for warning in record.warnings), record.warnings


def test_a_delay_in_a_loop_of_gain_one_is_legal_and_gets_a_pade_form_that_can_be_solved():
    text = """def looped(g):
    g.add("LFilter", "plant")
    g.add("ConstZero", "zero")
    g.add("Gain_dq", "unit", k=1.0)
    g.add("Delay", "delay", T_d=0.0001)
    g.add("Gain_dq", "gain")
    g.connect("v_DQ", "plant.v_in")
    g.connect("v_DQ", "unit.in_")
    g.connect("delay.out", "unit.in_")
    g.connect("unit.out", "delay.in_")
    g.connect("unit.out", "gain.in_")
    g.connect("gain.out", "plant.u_r")
    g.connect("zero.out", "plant.delta_omega")
    g.connect("plant.i_g", "i_DQ")
"""
    diagram = ibrid.parse_program(text)
    assert not ibrid.violations(diagram)
    record = ibrid.evaluate(diagram, benchmark(), restarts=0)
    assert record.outcome == "ok", record.reasons


def test_power_in_watts_is_suspected_when_the_fit_is_bad():
    sweep = benchmark()
    points = tuple(
        PointSweep(
            OperatingPoint(point.op.name, 3.0 * point.op.p, point.op.q),
            point.frequency,
            point.admittance,
        )
        for point in sweep.points
    )
    record = ibrid.evaluate(ibrid.textbook("naive"), replace(sweep, points=points), restarts=0)
    assert any("divide them by the rated power" in warning for warning in record.warnings)


@pytest.mark.parametrize("wrong", [("nive", 0), (0, "paper_lke")])
def test_names_of_no_diagram_and_no_sweep_are_one_sentence(wrong):
    diagram, sweep = wrong[0] or ibrid.textbook("naive"), wrong[1] or benchmark()
    with pytest.raises(ibrid.IbridError, match=r"did you mean (naive|paper_like)") as caught:
        ibrid.evaluate(diagram, sweep)
    assert "\n" not in str(caught.value)
