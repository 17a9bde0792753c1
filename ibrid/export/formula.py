"""Formulas as text: a law written with + - * / on numbers gives Modelica when it is given these
instead.
"""

from dataclasses import dataclass
from typing import Union

Operand = Union["Formula", float, int]

_SUM, _PRODUCT, _ATOM = range(3)


@dataclass(frozen=True)
class Formula:
    """Text of an expression; `binds` : how tightly its outermost operation does, so that brackets
    stand where needed.
    """

    text: str
    binds: int = _ATOM

    def __add__(self, other: Operand) -> "Formula":
        return self if _is(other, 0) else Formula(f"{self.text} + {_in(other, _PRODUCT)}", _SUM)

    def __radd__(self, other: Operand) -> "Formula":
        return self if _is(other, 0) else formula(other) + self

    def __sub__(self, other: Operand) -> "Formula":
        return self if _is(other, 0) else Formula(f"{self.text} - {_in(other, _PRODUCT)}", _SUM)

    def __rsub__(self, other: Operand) -> "Formula":
        return -self if _is(other, 0) else formula(other) - self

    def __mul__(self, other: Operand) -> Operand:
        if _is(other, 0):
            return 0
        return (
            self
            if _is(other, 1)
            else Formula(f"{_in(self, _PRODUCT)}*{_in(other, _ATOM)}", _PRODUCT)
        )

    def __rmul__(self, other: Operand) -> Operand:
        if _is(other, 0):
            return 0
        if _is(other, 1):
            return self
        return -self if _is(other, -1) else formula(other) * self

    def __truediv__(self, other: Operand) -> "Formula":
        return (
            self
            if _is(other, 1)
            else Formula(f"{_in(self, _PRODUCT)}/{_in(other, _ATOM)}", _PRODUCT)
        )

    def __rtruediv__(self, other: Operand) -> Operand:
        return 0 if _is(other, 0) else formula(other) / self

    def __neg__(self) -> "Formula":
        return Formula(f"-{_in(self, _PRODUCT)}", _SUM)

    def __pow__(self, other: Operand) -> "Formula":
        return Formula(f"{_in(self, _ATOM)}^{_in(other, _ATOM)}", _PRODUCT)

    def cos(self) -> "Formula":
        """cos of an angle in rad."""
        return Formula(f"cos({self.text})")

    def sin(self) -> "Formula":
        """sin of an angle in rad."""
        return Formula(f"sin({self.text})")

    def sqrt(self) -> "Formula":
        """Square root."""
        return Formula(f"sqrt({self.text})")


def formula(value: Operand) -> Formula:
    """A number as text with all its digits; a formula as it is."""
    if isinstance(value, Formula):
        return value
    text = (
        repr(int(value)) if float(value).is_integer() and abs(value) < 1e6 else repr(float(value))
    )
    return Formula(text, _SUM if text.startswith("-") else _ATOM)


def _is(value: Operand, number: int) -> bool:
    return isinstance(value, int | float) and value == number


def _in(value: Operand, place: int) -> str:
    """Its text, in brackets where it binds less tightly than the place demands."""
    inner = formula(value)
    return inner.text if inner.binds >= place else f"({inner.text})"
