"""A candidate tried: the fits that it poses, what ends a trial without an answer, and what a free
number must pay.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.assembly.symbolic import symbolic_model
from ibrid.errors import IbridError
from ibrid.fit.problem import Problem
from ibrid.measurement.sweeps.sweep import PointSweep
from ibrid.structure.compiling.compiled import CompiledDiagram
from ibrid.study import Study
from ibrid_search.settings import SearchSettings

#: What ends the trial of a candidate without an answer: it is illegal, its own kind breaks off, or
#: its numbers leave the range of arithmetic. Anything else is a mistake of ours.
NO_ANSWER = (IbridError, np.linalg.LinAlgError, FloatingPointError, OverflowError)
#: What a free number must gain in ln(error) where the noise is not known, as where parents are
#: ranked.
PRICE = SearchSettings().parsimony


def problems_of(
    compiled: CompiledDiagram, study: Study, groups: Sequence[Sequence[PointSweep]]
) -> list[Problem]:
    """Pose the fits of a diagram to groups of operating points; DiagramError where it has no
    matrices.
    """
    model = symbolic_model(compiled.wiring, **study.physics)
    return [Problem(model, group) for group in groups]
