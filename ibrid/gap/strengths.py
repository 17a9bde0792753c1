"""Strengths that several effects share: corner frequencies, gains of a PI controller."""

from math import pi

from ibrid.gap.effect import Strength

#: Corner frequency in rad/s above which a low-pass does nothing in any sweep, to rounding.
FAR = 1e14


def cutoff(*hertz: float) -> Strength:
    """A low-pass, from corner frequencies in Hz."""
    return Strength(tuple(2 * pi * one for one in hertz), FAR)


def pi_gains(name: str, kP: tuple[float, ...], kI: tuple[float, ...], *, vanishes: bool) -> dict[str, Strength]:
    """Both gains of the PI controller `name`; `vanishes` : with gains of zero the model is as before."""
    nothing = 0.0 if vanishes else None
    return {f"{name}.kP": Strength(kP, nothing), f"{name}.kI": Strength(kI, nothing)}
