"""A first look at an edit before it is proposed: how far a few steps of the fit lead from the
parent's values.

An upper end of what the fit will find, at a tenth of its cost: enough to tell which of several
usual edits the data ask for.
"""

from dataclasses import dataclass
from math import inf, log, sqrt

import numpy as np

from ibrid.fit import kernel
from ibrid.fit.least_squares import LEVENBERG
from ibrid.fit.objective import objective_for
from ibrid.fit.problem import Misfit, Problem
from ibrid.fit.starts import StartDrawer
from ibrid.measurement.sweeps.sweep import measured_numbers
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.wiring import Wiring
from ibrid_search.proposal import Context
from ibrid_search.screening.candidate_problems import NO_FIT_ERRORS, PARAMETER_COST, pose_problems
from ibrid_search.screening.selection_criterion import bic_parameter_cost
from ibrid_search.screening.settings import SCREENING

#: Draws of the numbers that the parent lacks, how many of them descend, and so many steps.
DRAWS, KEPT, STEPS = 16, 3, 24
#: How often a proposer that can looks at several edits and proposes the best; otherwise one is
#: proposed unseen, since what needs a second edit before it gains looks worthless.
LOOKED_AT = 0.5
#: Name of the number of first looks in the usage of a proposal.
LOOKS = "first_looks"


@dataclass(frozen=True)
class Look:
    """`error` : ln(NRMSE) after the look, infinite where there is no response.

    `price` : of all free numbers of a point.
    """

    error: float
    price: float = 0.0

    @property
    def worth(self) -> float:
        """What edits are compared by; the lower the better."""
        return self.error + self.price


def first_look(diagram: Diagram, context: Context, rng: np.random.Generator) -> Look:
    """How well the diagram answers after a few steps of the fit from the parent's values.

    The price of a free number is that of the Bayesian information criterion where the noise is
    known, else `PARAMETER_COST`.

    An edit without matrices or a response looks worthless, and so does one whose kind, a user's
    own, breaks off; its evaluation says why.
    """
    study = context.study
    kernel.load()
    try:
        points, groups = study.sweep.points, study.groups
        compiled = study.compiled(diagram)
        problems = pose_problems(compiled, study, groups)
        error = float(
            np.mean([_error(problem, compiled.wiring, context, rng) for problem in problems])
        )
    except NO_FIT_ERRORS:
        return Look(inf)
    if not np.isfinite(error):
        return Look(inf)
    known = objective_for(points) == "sigma"
    price = bic_parameter_cost(measured_numbers(points), len(groups)) if known else PARAMETER_COST
    return Look(log(max(error, SCREENING.exact_error)), price * problems[0].size)


def _error(problem: Problem, wiring: Wiring, context: Context, rng: np.random.Generator) -> float:
    """Root of the mean squared error over the operating points of a problem."""
    objective, before = objective_for(problem.points), context.parent.record.parameters
    drawer = StartDrawer(problem, wiring, context.study.sweep.omega_0)
    starts = drawer.completed(
        rng, [before.get(point.op.name, {}) for point in problem.points], DRAWS
    )
    model = Misfit(problem, objective)
    cost = LEVENBERG.go(model, LEVENBERG.begin(model, starts).best(KEPT), STEPS).cost.min()
    return sqrt(cost / len(problem.points)) if np.isfinite(cost) else inf
