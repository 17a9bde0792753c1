"""Between which numbers each key of a file and each option must lie: key -> unit, lower, upper, in
one place.

The ranges are wide: they refuse what no measurement, device or grid can be and what would overflow,
not what is unlikely.
"""

from math import isfinite, nan
from typing import NamedTuple

from ibrid.errors import SweepError

#: Digits of a whole number that somebody writes: all of them are below 2**63.
LONGEST_WHOLE = 18


class Bounds(NamedTuple):
    """`unit` : as it is written behind a number, "" for none. `lower`, `upper` : included."""

    unit: str
    lower: float
    upper: float


#: f0_hz: of railways, grids, ships and aircraft. grid_r, grid_x: wider than what scr and xr make.
#: p, q, v: also in W and V, before the base is known.
LIMITS = {
    "f0_hz": Bounds("Hz", 10.0, 1000.0),
    "s_base_va": Bounds("VA", 1e-6, 1e15),
    "v_base_v": Bounds("V", 1e-6, 1e9),
    "sampling_hz": Bounds("Hz", 1e-3, 1e12),
    "frame_deg": Bounds("degrees", -36e3, 36e3),
    "freq_hz": Bounds("Hz", 1e-12, 1e12),
    "rate": Bounds("samples per second", 0.0, 1e12),
    "recorded": Bounds("samples", 1.0, 2e7),
    "ranked": Bounds("s", 0.0, 20.0),
    "scr": Bounds("", 1e-6, 1e9),
    "xr": Bounds("", 1e-6, 1e9),
    "grid": Bounds("per unit", 0.0, 1e6),
    "grid_r": Bounds("per unit", 0.0, 1e9),
    "grid_x": Bounds("per unit", 1e-18, 1e9),
    "dip": Bounds("of the voltage at rest", 0.0, 10.0),
    "p_ref": Bounds("per unit", -10.0, 10.0),
    "q_ref": Bounds("per unit", -10.0, 10.0),
    "swell": Bounds("of the voltage at rest", 0.0, 10.0),
    "step": Bounds("per unit", -10.0, 10.0),
    "phase": Bounds("degrees", -3600.0, 3600.0),
    "frequency": Bounds("Hz", -1000.0, 1000.0),
    "skew": Bounds("us", -1e6, 1e6),
    "p": Bounds("", -1e15, 1e15),
    "q": Bounds("", -1e15, 1e15),
    "v": Bounds("", 1e-12, 1e12),
    "ratio": Bounds("", 1e-3, 1e3),
    "shift_deg": Bounds("degrees", -360.0, 360.0),
    "tolerance": Bounds("", 0.0, 1.0),
    "relative_noise": Bounds("of what is measured", 1e-6, 1e6),
    "noise_db": Bounds("dB", -100.0, 400.0),
    "repeats": Bounds("runs", 1, 10_000),
    "value": Bounds("", -1e12, 1e12),
    "step_s": Bounds("s", 1e-9, 0.1),
    "settle_s": Bounds("s", 0.0, 1e4),
    "scale": Bounds("", -1e12, 1e12),
    "peak": Bounds("per unit", 1e-9, 1.0),
}


def written_number(text: str) -> float:
    """The number in a word of the user's, in plain decimal digits. Raises ValueError, also for 1_0
    and for the digits of other scripts, which Python takes.
    """
    return float(_plain(text))


def written_whole(text: str) -> int:
    """The whole number in a word of the user's, as `written_number`, of at most `LONGEST_WHOLE`
    digits.
    """
    if len(text) > LONGEST_WHOLE:
        raise ValueError(f"more than {LONGEST_WHOLE} digits")
    return int(_plain(text))


def _plain(text: str) -> str:
    if not text.isascii() or "_" in text:
        raise ValueError("no plain decimal number")
    return text


def finite_number(value: object) -> float | None:
    """A finite number as a float; None for anything else, such as a truth value or a whole number
    beyond every float.
    """
    try:
        number = (
            nan if isinstance(value, bool) or not isinstance(value, int | float) else float(value)
        )
    except OverflowError:
        return None
    return number if isfinite(number) else None


def require_in_range(
    key: str, value: float, what: str, error: type[Exception] = SweepError
) -> None:
    """Raise `error`, which names key and range, unless a number lies within the limits of the key.

    what : how the sentence begins, with the key as the user wrote it.
    """
    unit, lower, upper = LIMITS[key]
    number = finite_number(value)
    if number is None or not lower <= number <= upper:
        found = f"{value!r:.40}" if number is None else f"{number:g}"
        raise error(
            f"{what} must be {lower:g} to {upper:g}{f' {unit}' if unit else ''}; found {found}."
        )
