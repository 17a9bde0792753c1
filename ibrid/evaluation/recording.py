"""The record of a diagram at given values: everything that `evaluate` says, with nothing fitted."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Unpack

import numpy as np

from ibrid.assembly.symbolic import symbolic_model
from ibrid.evaluation.describe import Fitted, describe, unfitted
from ibrid.evaluation.record import Record
from ibrid.fit.multistart import Solution
from ibrid.fit.problem import Problem
from ibrid.measurement.sweep import Sweep
from ibrid.structure.check import examine
from ibrid.structure.diagram import Diagram
from ibrid.structure.wiring import wire
from ibrid.study import Study, StudyOptions


def record_at(
    diagram: Diagram, sweep: Sweep | Study, values: Mapping[str, float], **options: Unpack[StudyOptions]
) -> Record:
    """Describe a diagram at values of its free parameters, shared by all operating points, equilibria computed.

    sweep : a study, or the data of one with `options`. values : free name -> value, clipped to its box. Intervals are
    those of an estimator that weighs the data by their noise where the sweep has a sigma. The outcome is `invalid` for
    an illegal diagram.
    """
    study = Study.of(sweep, **options)
    diagram = study.placed(diagram)
    effort = study.effort()
    found, habits = examine(diagram, study.kinds, equilibrium=study.equilibrium)
    base = replace(unfitted(diagram, study, effort), reasons=tuple(map(str, found)), warnings=tuple(map(str, habits)))
    if found:
        return base
    wiring = wire(diagram, study.kinds)
    model = symbolic_model(
        wiring,
        equilibrium=study.equilibrium,
        power_node=study.sweep.power_node,
        omega_0=study.sweep.omega_0,
    )
    problem = Problem(model, study.fitted.points)
    x = problem.coordinates.to_x(np.array([values[one.name] for one in problem.numbers]))
    x = np.clip(x, problem.coordinates.x_low, problem.coordinates.x_high)
    solution = Solution(
        x=x,
        errors=np.sqrt(problem.costs(x[None], effort.minimised)[0]),
        twins=(),
        finished=(),
        independent=1,
        agreeing=1,
        waves=0,
        evaluations=0,
        ipopt_status="nothing fitted",
        ipopt_iterations=0,
    )
    return replace(describe(diagram, wiring, study, effort.minimised, base, [Fitted(problem, solution)]), reasons=())
