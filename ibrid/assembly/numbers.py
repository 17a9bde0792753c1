"""The few operations that floats and CasADi symbols spell differently."""

from typing import Any

import casadi as ca


def is_zero(value: Any) -> bool:
    """True for a number that is zero and a symbol that is structurally zero."""
    return bool(value.is_zero()) if isinstance(value, ca.SX) else value == 0


def square_root(value: Any) -> Any:
    """Square root of a float or a symbol; not a number below zero."""
    if isinstance(value, float | int):
        return value**0.5 if value >= 0 else float("nan")
    return ca.sqrt(value)
