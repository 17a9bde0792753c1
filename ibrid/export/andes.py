"""A Python module that ANDES 2 loads: the linear model as a generator that takes the place of a
static one.
"""

import re

import numpy as np

from ibrid.analysis.models.linear_model import UNITS, LinearModel
from ibrid.export.c_source import template
from ibrid.export.modelica import identifiers, weighted
from ibrid.export.names import PYTHON, written_in


@written_in(PYTHON)
def andes(model: LinearModel, name: str = "LinearInverter") -> bytes:
    """The file's content: a model class of that name in the group RenGen, and `add_to(system)`.

    States are called x_pll_angle and so on; v_D, v_Q are deviations in the frame of the bus voltage
    of the load flow.
    """
    states = tuple(f"x_{one}" for one in identifiers(model.states))
    columns = (*states, "v_D", "v_Q")
    rates, currents = np.hstack([model.A, model.B]), np.hstack([model.C, model.D])
    introduction = (
        f"{model.name} at {model.op}, written by ibrid: p = {model.p!r}, q = {model.q!r} at the "
        f"{model.power_node}, "
        f"v = {model.v!r}.\n\n{UNITS}."
    )
    constants = "\n".join(f"{word.upper()} = {value!r}" for word, value in model.at_rest().items())
    filled = {
        "INTRODUCTION": introduction,
        "CONSTANTS": f"# the terminals at rest: per unit, rad/s, VA, V\n{constants}",
        "STATE_NAMES": repr(states),
        "RATE_LINES": "\n".join(f'    "{weighted(row, columns)}",' for row in rates),
        "CURRENT_LINES": "\n".join(f'    "{weighted(row, columns)}",' for row in currents),
        "MODULE": name,
        "CLASS": name,
    }
    return re.sub(
        "|".join(filled), lambda found: filled[found[0]], template("andes_model.txt")
    ).encode()
