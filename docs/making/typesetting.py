"""Names and expressions of the code as LaTeX: omega_0/L_F is a fraction, kP_pll a k with indices,
i_eq_q a component.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

_GREEK = ("alpha", "delta", "eta", "kappa", "omega", "phi", "tau")


def symbol(name: str) -> str:
    """A name with its indices: words upright, single letters as variables."""
    if name in ("cos_delta", "sin_delta"):
        return rf"\{name[:3]}\delta"
    base, *marks = [part for part in name.replace("delta_omega", "Delta").split("_") if part]
    if found := re.fullmatch(r"([kVIE])([PI0])(d|q)?", base):
        base, marks = found[1], ["".join(found.groups("")[1:]), *marks]
    letter = r"\Delta\omega" if base == "Delta" else _letter(base)
    return f"{letter}_{{{','.join(map(_letter, marks))}}}" if marks else letter


def _letter(word: str) -> str:
    if word in _GREEK:
        return f"\\{word}"
    return word if len(word) == 1 or word[0] == "0" else rf"\mathrm{{{word}}}"


@dataclass(frozen=True)
class Term:
    """A product: its number, and the powers of its factors in LaTeX.

    Sums are one factor in brackets.
    """

    number: Fraction
    powers: tuple[tuple[str, Fraction], ...] = ()

    def __mul__(self, other: "Term") -> "Term":
        powers = Counter(dict(self.powers))
        for factor, power in other.powers:
            powers[factor] += power
        return Term(
            self.number * other.number,
            tuple((factor, power) for factor, power in powers.items() if power),
        )

    def __pow__(self, power: Fraction) -> "Term":
        if power.denominator > 1 and self.number != 1:
            raise ValueError("roots are those of names and sums")
        return Term(
            self.number ** int(power), tuple((factor, one * power) for factor, one in self.powers)
        )

    def tex(self) -> str:
        """Its size, without the sign."""
        over = [_power(factor, power) for factor, power in self.powers if power > 0]
        under = [_power(factor, -power) for factor, power in self.powers if power < 0]
        above, below = abs(self.number.numerator), self.number.denominator
        over = ([str(above)] if above != 1 or not over else []) + over
        under = ([str(below)] if below != 1 else []) + under
        return rf"\frac{{{_product(over)}}}{{{_product(under)}}}" if under else _product(over)


def expression(text: str) -> str:
    """LaTeX of an expression such as (-omega_0/L_F)*R_F; factors are gathered, sums stay as they
    are.
    """
    return _sum(_terms(ast.parse(text.replace("^", "**"), mode="eval").body))


def _terms(node: ast.expr) -> list[Term]:
    match node:
        case ast.BinOp(left, ast.Add(), right):
            return _terms(left) + _terms(right)
        case ast.BinOp(left, ast.Sub(), right):
            return _terms(left) + _negative(_terms(right))
        case ast.UnaryOp(ast.USub(), inner):
            return _negative(_terms(inner))
    return [_term(node)]


def _term(node: ast.expr) -> Term:
    match node:
        case ast.Constant(value):
            return Term(Fraction(repr(value)))
        case ast.Name(name):
            return Term(Fraction(1), ((symbol(name), Fraction(1)),))
        case ast.UnaryOp(ast.USub(), inner):
            return Term(Fraction(-1)) * _term(inner)
        case ast.BinOp(left, ast.Mult(), right):
            return _term(left) * _term(right)
        case ast.BinOp(left, ast.Div(), right):
            return _term(left) * _term(right) ** Fraction(-1)
        case ast.BinOp(left, ast.Pow(), ast.Constant(value)):
            return _term(left) ** Fraction(repr(value))
        case ast.Call(ast.Name("sqrt"), [inner]):
            return _term(inner) ** Fraction(1, 2)
        case ast.Call(ast.Name(name), [inner]):
            return Term(Fraction(1), ((rf"\{name}{_sum(_terms(inner))}", Fraction(1)),))
    terms = _terms(node)
    return (
        terms[0]
        if len(terms) == 1
        else Term(Fraction(1), ((rf"\left({_sum(terms)}\right)", Fraction(1)),))
    )


def _negative(terms: Iterable[Term]) -> list[Term]:
    return [Term(-term.number, term.powers) for term in terms]


def _sum(terms: list[Term]) -> str:
    first, *others = terms
    text = f"{'-' if first.number < 0 else ''}{first.tex()}"
    return text + "".join(f" {'-' if term.number < 0 else '+'} {term.tex()}" for term in others)


def _power(factor: str, power: Fraction) -> str:
    whole, half = divmod(power, 1)
    if half not in (0, Fraction(1, 2)):
        raise ValueError(f"{factor} to the power {power}: powers are halves")
    root = rf"\sqrt{{{bare(factor)}}}" if half else ""
    most = (factor if whole == 1 else f"{factor}^{{{whole}}}") if whole else ""
    return rf"{most}\,{root}" if most and root else most or root


def _product(factors: list[str]) -> str:
    if len(factors) == 1:
        return bare(factors[0])
    return r"\,".join(factors)


def bare(factor: str) -> str:
    """A factor without the brackets that stand around all of it."""
    inner = factor.removeprefix(r"\left(").removesuffix(r"\right)")
    return (
        inner
        if factor == rf"\left({inner}\right)" and r"\right)" not in inner.split(r"\left(")[0]
        else factor
    )
