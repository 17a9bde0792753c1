"""The few operations that floats and CasADi symbols spell differently."""

from collections.abc import Iterable
from typing import Any

import casadi as ca


def _operator(operation: int) -> tuple[Any, Any]:
    """An operation with a symbol on its left, and on its right."""

    def forward(one: Any, other: Any) -> "Scalar":
        found: Any = ca.SX.binary(operation, one, other)
        found.__class__ = Scalar
        return found

    return forward, lambda one, other: forward(other, one)


class Scalar(ca.SX):
    """One symbol, whose arithmetic goes straight to its operation.

    The operators of casadi try every type that they know, ten times as long, and a diagram takes
    hundreds of them.
    """

    __add__, __radd__ = _operator(ca.OP_ADD)
    __sub__, __rsub__ = _operator(ca.OP_SUB)
    __mul__, __rmul__ = _operator(ca.OP_MUL)
    __truediv__, __rtruediv__ = _operator(ca.OP_DIV)

    def __neg__(self) -> "Scalar":
        found: Any = ca.SX.unary(ca.OP_NEG, self)
        found.__class__ = Scalar
        return found


def is_zero(value: Any) -> bool:
    """True for a number that is zero and a symbol that is structurally zero."""
    return bool(value.is_zero()) if isinstance(value, ca.SX) else value == 0


def weighted_sum(terms: Iterable[tuple[Any, Any]]) -> Any:
    """Sum of gain times value, without the operations that change nothing; 0.0 of no terms."""
    total = None
    for gain, value in terms:
        if is_zero(gain) or is_zero(value):
            continue
        unit = not isinstance(gain, ca.SX) and gain == 1
        term = value if unit else gain * value
        total = term if total is None else total + term
    return 0.0 if total is None else total


def zero_of(value: Any) -> Any:
    """0 for a number; not a number for what is none."""
    return (
        ca.if_else(value > -float("inf"), 0.0, float("nan"))
        if isinstance(value, ca.SX)
        else 0.0 * value
    )
