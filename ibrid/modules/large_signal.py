"""The law of a kind in absolute quantities, of which its state space is the linearisation at the
operating point.

A kind whose `state_space` asks for no operating point is linear, so that the state space is its law
at any size.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from inspect import signature
from math import cos, nan, sin
from typing import TYPE_CHECKING, Any

from ibrid.border import methods_take_kinds
from ibrid.errors import ModuleError
from ibrid.modules.own_law import call_law

if TYPE_CHECKING:
    from ibrid.modules.kind import Matrices, ModuleKind

Motion = tuple[Sequence[Any], Sequence[Any]]


@methods_take_kinds
@dataclass(frozen=True)
class LargeSignal:
    """How a kind moves, whatever the size of its signals.

    Parameters
    ----------
    law : returns (dx/dt, outputs), flat, from `x`, a tuple of the states, and by argument name: the
    input ports (a pair
        for dq_vec, else a scalar), the parameters, `omega_0`, and `PORT_eq` for constants of the
        operating point. With + - * / and `cosine`, `sine`, `square_root`, so that numbers, CasADi
        symbols and text all work.
    at_rest : returns the states at the operating point, from the same parameters and `PORT_eq`, as
    the law from numbers and
        CasADi symbols; None: without states.
    angle : input that at rest is the angle of the controller frame. Inputs that are neither this
    nor among the
        operating points of the state space, such as a frequency deviation, are zero at rest.
    """

    law: Callable[..., Motion]
    at_rest: Callable[..., Sequence[Any]] | None = None
    angle: str | None = None


def is_linear(kind: "ModuleKind") -> bool:
    """True for a kind whose state space is its law: no operating point and no frame in its
    matrices.
    """
    return kind.large_signal is None and not kind.equilibrium_ports and not kind.uses_frame


def require_large_signal(kind: "ModuleKind") -> None:
    """Raise ModuleError where a kind says what it does near the operating point alone."""
    if kind.large_signal is None and not is_linear(kind):
        raise ModuleError(
            f"{kind.name} has matrices that depend on the operating point and no large-signal law; "
            "declare "
            f"{kind.name} with large_signal=LargeSignal(...), or export the linear model"
        )


def motion(
    kind: "ModuleKind",
    x: Sequence[Any],
    inputs: Mapping[str, Any],
    arguments: Mapping[str, Any],
    matrices: "Matrices | None" = None,
) -> Motion:
    """(dx/dt, outputs) of a module, each flat.

    x : states. inputs : port -> scalar or pair, absolute. arguments : parameters, `omega_0` and
    `PORT_eq`, as many as the
    law asks for. matrices : of a linear kind whose state space is not `kind.state_space`, such as
    the Pade form of a delay.
    """
    require_large_signal(kind)
    if kind.large_signal is not None:
        return call_law(kind.name, kind.large_signal.law, tuple(x), **inputs, **arguments)
    a, b, c, d = kind.matrices(**arguments) if matrices is None else matrices
    pairs = (
        (inputs[port],) if signal.width == 1 else inputs[port]
        for port, signal in kind.inputs.items()
    )
    u = [value for pair in pairs for value in pair]
    return (
        [
            _sum([*zip(on_x, x, strict=True), *zip(on_u, u, strict=True)])
            for on_x, on_u in zip(a, b, strict=True)
        ],
        [
            _sum([*zip(on_x, x, strict=True), *zip(on_u, u, strict=True)])
            for on_x, on_u in zip(c, d, strict=True)
        ],
    )


def asked(function: Callable[..., Any], known: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the known arguments that a function has."""
    return {name: known[name] for name in _arguments(function) if name in known}


@cache
def _arguments(function: Callable[..., Any]) -> tuple[str, ...]:
    return tuple(signature(function).parameters)


def cosine(angle: Any) -> Any:
    """Of a number, a CasADi symbol or text."""
    return cos(angle) if isinstance(angle, int | float) else angle.cos()


def sine(angle: Any) -> Any:
    """Of a number, a CasADi symbol or text."""
    return sin(angle) if isinstance(angle, int | float) else angle.sin()


def square_root(value: Any) -> Any:
    """Of a number, a CasADi symbol or text; not a number below zero."""
    return (value**0.5 if value >= 0 else nan) if isinstance(value, int | float) else value.sqrt()


def reciprocal(value: Any) -> Any:
    """1/value of a number, a CasADi symbol or text; not a number of zero, where there is no such
    operating point.
    """
    return nan if isinstance(value, int | float) and value == 0 else 1 / value


def dot(a: Any, b: Any) -> Any:
    """a' b of two pairs; of voltage and current the power p."""
    return a[0] * b[0] + a[1] * b[1]


def reactive(a: Any, b: Any) -> Any:
    """a' J b of two pairs; of voltage and current the power q."""
    return a[1] * b[0] - a[0] * b[1]


def length(a: Any) -> Any:
    """|a| of a pair."""
    return square_root(dot(a, a))


def _sum(terms: Sequence[tuple[Any, Any]]) -> Any:
    """Of gain times value, without the terms whose gain is the number zero."""
    total: Any = None
    for gain, value in terms:
        if isinstance(gain, int | float) and gain == 0:
            continue
        term = value if isinstance(gain, int | float) and gain == 1 else gain * value
        total = term if total is None else total + term
    return 0.0 if total is None else total
