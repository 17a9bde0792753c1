"""Numbers as an engineer writes them: few digits, exponents only where needed, cutoffs also in
Hz.
"""

import math
from collections.abc import Sequence

from ibrid.measurement.sweeps.quantities import hertz

NOTHING = "-"


def number(value: float | None, digits: int = 4) -> str:
    """A value with `digits` significant digits: 0.07213, 1400, 1.15e-5."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0:
        return "0"
    if 1e-3 <= abs(value) < 1e5:
        places = digits - 1 - math.floor(math.log10(abs(value)))
        text = f"{round(value, places):.{max(places, 0)}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"


def error(value: float | None) -> str:
    """A relative error with three significant digits, "-" where there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0 or 1e-4 <= abs(value) < 1e3:
        return f"{value:#.3g}".rstrip(".")
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def p_value(value: float) -> str:
    """A probability; what no data can tell from zero is not written out."""
    return "< 1e-12" if value < 1e-12 else error(value)


def percent(value: float) -> str:
    """A part as a percentage."""
    return f"{number(100 * value, 2)} %"


def seconds(value: float) -> str:
    """A duration with its unit."""
    return _prefixed(value, "s")


_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"))


def _prefixed(value: float, unit: str) -> str:
    scale, prefix = next((one for one in _PREFIXES if abs(value) >= one[0]), _PREFIXES[-1])
    return f"{number(value / scale, 3)} {prefix}{unit}"


def more_readable(value: float, unit: str) -> str:
    """The same value in the unit one thinks in, or "": rad/s in Hz, s in ms or us, rad in
    degrees.
    """
    if unit == "rad/s":
        return hertz(value / (2 * math.pi))
    if unit == "s" and 0 < abs(value) < 1:
        return seconds(value)
    if unit == "rad":
        return f"{number(math.degrees(value), 3)} deg"
    return ""


#: Word in a parameter's meaning -> its SI unit, and the powers of base impedance and nominal
#: angular frequency in it.
_SI = {"inductance": ("H", 1, -1), "resistance": ("ohm", 1, 0), "capacitance": ("F", -1, -1)}


def in_si(value: float, meaning: str, z_base: float, omega_0: float) -> str:
    """A per-unit inductance, resistance or capacitance in SI, "" for what is none.

    z_base : ohm. omega_0 : rad/s.
    """
    found = next((told for word, told in _SI.items() if word in meaning), None)
    if found is None:
        return ""
    unit, impedance, frequency = found
    return _prefixed(value * z_base**impedance * omega_0**frequency, unit)


def interval(value: float, ends: Sequence[float] | None, box: Sequence[float] | None) -> str:
    """A 95 % interval in words: "+- 2.1 %" where it is tight and even, "a to b" otherwise."""
    if ends is None:
        return "not visible"
    low, high = ends
    if box is not None and low <= box[0] and high >= box[1]:
        return "the whole box"
    half = max(high - value, value - low) / abs(value) if value else math.inf
    if half < 1e-5:
        return "+- < 0.001 %"
    if half < 0.05:
        return f"+- {percent(half)}"
    return f"{number(low, 3)} to {number(high, 3)}"
