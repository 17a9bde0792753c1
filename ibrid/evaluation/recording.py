"""The record of a diagram at given values: everything that `evaluate` says, with nothing fitted."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ibrid.assembly.symbolic import symbolic_model
from ibrid.evaluation.describe import Fitted, describe
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.plan import make_plan
from ibrid.evaluation.record import Record
from ibrid.evaluation.reward import reward
from ibrid.fit.multistart import Solution
from ibrid.fit.problem import Problem
from ibrid.measurement.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.structure.check import examine
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import program_text
from ibrid.structure.wiring import wire


def record_at(
    diagram: Diagram,
    sweep: Sweep,
    values: Mapping[str, float],
    *,
    vocabulary: str | Sequence[ModuleKind] = "extended",
    holdout_op: str | Sequence[str] = (),
) -> Record:
    """Describe a diagram at values of its free parameters, shared by all operating points, equilibria computed.

    values : free name -> value, clipped to its box. Intervals are those of an estimator that weighs the data by their
    noise where the sweep has a sigma. The outcome is `invalid` for an illegal diagram.
    """
    plan = make_plan(sweep, "shared", "exact", vocabulary, None, None, 0, holdout_op, None)
    found, habits = examine(diagram, plan.kinds, equilibrium="exact")
    base = Record(
        outcome=Outcome.INVALID,
        reasons=tuple(map(str, found)),
        warnings=tuple(map(str, habits)),
        reward=reward(None),
        modules=len(diagram.instances),
        program=program_text(diagram),
        settings=plan.described(),
        vocabulary=plan.kinds,
    )
    if found:
        return base
    wiring = wire(diagram, plan.kinds)
    model = symbolic_model(wiring, equilibrium="exact", power_node=sweep.power_node, omega_0=sweep.omega_0)
    problem = Problem(model, plan.fitted.points)
    x = problem.coordinates.to_x(np.array([values[one.name] for one in problem.numbers]))
    x = np.clip(x, problem.coordinates.x_low, problem.coordinates.x_high)
    solution = Solution(
        x=x,
        errors=np.sqrt(problem.costs(x[None], plan.fit.minimised)[0]),
        twins=(),
        finished=(),
        independent=1,
        agreeing=1,
        waves=0,
        evaluations=0,
        ipopt_status="nothing fitted",
        ipopt_iterations=0,
    )
    return replace(describe(diagram, wiring, plan, base, [Fitted(problem, solution)]), reasons=())
