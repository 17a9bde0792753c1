"""Matrices of every module of a diagram at parameter values and an operating point, numbers or
symbols.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ibrid.assembly.equilibrium import device_equilibria, paper_equilibria
from ibrid.assembly.joined import Interconnected
from ibrid.assembly.numbers import zero_of
from ibrid.assembly.operating_point import Pair
from ibrid.assembly.signals_at_rest import Parameters, matrices_of
from ibrid.assembly.terminals import at_terminals, behind_terminals
from ibrid.errors import OperatingPointError
from ibrid.modules.delay import pade_state_space
from ibrid.modules.kind import Matrices
from ibrid.structure.reading.wiring import PLANT, Wiring


class ModuleMatrices(dict[str, Matrices]):
    """instance -> (A, B, C, D).

    `seen` : their joined system -> the one seen from where it was measured.
    """

    seen: Callable[[Interconnected], Interconnected]


def module_matrices(
    wiring: Wiring,
    parameters: Parameters,
    point: tuple[Any, Any, Any],
    *,
    equilibrium: str,
    power_node: str,
    omega_0: float,
    pade_orders: Mapping[str, int] | None = None,
) -> ModuleMatrices:
    """instance -> (A, B, C, D).

    Parameters
    ----------
    parameters : instance -> parameter -> value (`parameters_at`). point : (p, q, v) per unit,
    unused under `equilibrium="paper"`.
    pade_orders : instance -> order of the Pade form of each delay; without it a delay passes its
    input through.

    Where no real operating point exists the matrices of the plant are not numbers.
    """
    inner = behind_terminals(wiring.outside, wiring.plant, parameters, point, power_node)
    if equilibrium == "paper":
        at = paper_equilibria(wiring, parameters)
    else:
        at = device_equilibria(wiring.devices, parameters, inner.point, inner.power_node, omega_0)
    models = ModuleMatrices()
    models.seen = partial(
        at_terminals,
        outside=wiring.outside,
        parameters=parameters,
        turn=inner.turn,
        omega_0=omega_0,
    )
    for name, kind in wiring.kinds.items():
        if kind.delay is not None and pade_orders is not None:
            models[name] = pade_state_space(parameters[name][kind.delay], pade_orders[name])
        else:
            models[name] = matrices_of(kind, parameters[name], omega_0, *at[name])
        # only a node behind an impedance has a limit
        if (
            equilibrium != "paper"
            and kind.family == PLANT
            and ("L_g" in parameters[name] or wiring.outside)
        ):
            models[name] = _where_it_exists(models[name], at[name][1])
    return models


def _where_it_exists(matrices: Matrices, ports: Mapping[str, Pair]) -> Matrices:
    """The plant, not a number without a real operating point, also where no signal asks for that
    point.
    """
    a, b, c, d = matrices
    mark = zero_of(ports["i_g"][0])
    return [[a[0][0] + mark, *a[0][1:]], *a[1:]], b, c, d


def require_finite(matrices: Mapping[str, Matrices]) -> None:
    """Raise OperatingPointError, with the modules, where matrices in numbers are not finite."""
    wrong = [
        label
        for label, parts in matrices.items()
        if not all(np.isfinite(np.array(rows, dtype=float)).all() for rows in parts)
    ]
    if wrong:
        raise OperatingPointError(
            f"the matrices of {', '.join(wrong)} must be finite; with these values there is no "
            "real operating point, "
            "ask for less power, a higher voltage or a smaller impedance to the grid"
        )
