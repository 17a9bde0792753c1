"""Numbers as an engineer reads them."""

from math import isfinite


def hertz(value: float) -> str:
    """A frequency with three significant digits and its unit, kHz from 1000 Hz on."""
    return f"{_digits(value / 1000)} kHz" if abs(value) >= 999.5 else f"{_digits(value)} Hz"


def span(low: float, high: float) -> str:
    """From one frequency to another in a sentence: 5 Hz to 5 kHz; one alone where both read the
    same.
    """
    return hertz(low) if hertz(low) == hertz(high) else f"{hertz(low)} to {hertz(high)}"


def band(low: float, high: float) -> str:
    """A band in a table, in one unit where possible."""
    if low == high:
        return hertz(low)
    if (low >= 999.5) == (high >= 999.5):
        number, unit = hertz(low).split()
        return f"{number}-{hertz(high).split()[0]} {unit}"
    return f"{hertz(low)} - {hertz(high)}"


def engineering(value: float, unit: str) -> str:
    """A value with three significant digits and a prefix: 250 kVA, 0.4 V."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= 0.9995 * factor:
            return f"{_digits(value / factor)} {prefix}{unit}"
    return f"{_digits(value)} {unit}"


#: Per unit; what is smaller is what a solver or a filter left of zero.
SMALLEST_SET_POINT = 1e-6


def set_point(value: float) -> str:
    """One of p, q and v per unit with six significant digits, 0 for the rounding of a zero."""
    return "0" if abs(value) < SMALLEST_SET_POINT else f"{value:g}"


def percent(value: float) -> str:
    """Two significant digits."""
    return f"{float(f'{100 * value:.2g}'):g} %"


def counted(count: int, word: str) -> str:
    """So many of something: 1 sum, 2 sums."""
    return f"{count} {word}{'' if count == 1 else 's'}"


def _digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}" if isfinite(value) else "-"
