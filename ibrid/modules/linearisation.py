"""A large-signal law and a state space of one kind say the same near the operating point."""

from collections.abc import Mapping
from inspect import signature
from math import atan2
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ibrid.errors import ModuleError
from ibrid.modules.large_signal import LargeSignal

if TYPE_CHECKING:
    from ibrid.modules.kind import ModuleKind

#: Exact derivatives of two ways to write a law differ by a few roundings.
ROUNDING = 1e-12


def check_linearisation(kind: "ModuleKind", arguments: Mapping[str, Any]) -> None:
    """Raise ModuleError unless the derivatives of `kind.large_signal` are the matrices of `kind.state_space`.

    arguments : of `state_space`, in numbers, an operating point whose frame and equilibria are arbitrary.
    """
    if kind.large_signal is None:
        return
    found = _derivatives(kind, kind.large_signal, arguments)
    expected = [np.array(rows, dtype=float) for rows in kind.state_space(**arguments)]
    for name, one, other in zip("ABCD", found, expected, strict=True):
        other = other.reshape(one.shape)
        if one.size and not np.abs(one - other).max() <= ROUNDING * max(1.0, np.abs(other).max()):
            row, column = np.unravel_index(np.argmax(np.abs(one - other)), one.shape)
            raise ModuleError(
                f"{kind.name}: the large-signal law must linearise to the state space; {name}[{row}, {column}] is "
                f"{one[row, column]:.10g} by the law and {other[row, column]:.10g} in state_space, correct one of them"
            )


def _derivatives(kind: "ModuleKind", large: LargeSignal, arguments: Mapping[str, Any]) -> list[np.ndarray]:
    """A, B, C, D of the law, by CasADi."""
    at_rest = [] if large.at_rest is None else [*large.at_rest(**_asked(kind, large.at_rest, arguments))]
    x = ca.SX.sym("x", len(kind.states))
    inputs, resting = {}, []
    for port, signal in kind.inputs.items():
        some = ca.SX.sym(port, signal.width)
        inputs[port] = some if signal.width == 1 else (some[0], some[1])
        if port == large.angle:
            c, s = arguments.get("frame", (1.0, 0.0))
            resting.append(atan2(s, c))
        else:
            resting += arguments.get(f"{port}_eq", (0.0, 0.0))[: signal.width]
    u = ca.vertcat(*[ca.vertcat(*one) if isinstance(one, tuple) else one for one in inputs.values()])
    constants = _asked(kind, large.law, arguments)
    rates, outputs = large.law(tuple(x[k] for k in range(len(kind.states))), **inputs, **constants)
    parts = [ca.vertcat(*map(ca.SX, one)) if len(one) else ca.SX(0, 1) for one in (rates, outputs)]
    jacobians = [ca.densify(ca.jacobian(part, by)) for part in parts for by in (x, u)]
    return [
        np.array(one) for one in ca.Function("derivatives", [x, u], jacobians).call([ca.DM(at_rest), ca.DM(resting)])
    ]


def _asked(kind: "ModuleKind", function: Any, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the arguments of `state_space` that a law has; ModuleError where it has others."""
    names = [name for name in signature(function).parameters if name != "x" and name not in kind.inputs]
    if unknown := [name for name in names if name not in arguments]:
        raise ModuleError(
            f"{kind.name}: its large-signal law asks for {unknown[0]}, which is neither x, an input nor an argument of "
            f"state_space ({', '.join(arguments)})"
        )
    return {name: arguments[name] for name in names}
