"""The fit problems of a candidate diagram, and the errors after which it counts as not fitted."""

from collections.abc import Sequence

import numpy as np

from ibrid.assembly.symbolic import symbolic_model
from ibrid.errors import IbridError
from ibrid.fit.problem import Problem
from ibrid.measurement.sweeps.sweep import PointSweep
from ibrid.structure.compiling.compiled import CompiledDiagram
from ibrid.study import Study
from ibrid_search.settings import SearchSettings

#: Errors that leave a candidate without a fit: an invalid diagram, a module of a user that fails,
#: values beyond floating point. Any other error is a bug of ours and is not caught.
NO_FIT_ERRORS = (IbridError, np.linalg.LinAlgError, FloatingPointError, OverflowError)
#: Cost of a free parameter in ln(error) where the noise is unknown, as in the ranking of parents.
PARAMETER_COST = SearchSettings().parsimony


def pose_problems(
    compiled: CompiledDiagram, study: Study, groups: Sequence[Sequence[PointSweep]]
) -> list[Problem]:
    """Pose one fit problem of a diagram for each group of operating points.

    The operating points of a group share their parameters. Raises DiagramError where an algebraic
    loop leaves the diagram without system matrices.
    """
    model = symbolic_model(compiled.wiring, **study.physics)
    return [Problem(model, group) for group in groups]
