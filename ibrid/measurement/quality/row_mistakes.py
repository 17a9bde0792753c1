"""Mistakes that spoil a row of a sweep as people make them, and what the row would be without
each.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ibrid.measurement.sweeps.sweep import ENTRIES

#: How many times too large a number may be -> what that looks like.
FACTORS = {
    10.0: "a slip of the decimal point",
    0.1: "a slip of the decimal point",
    100.0: "a slip of the decimal point, or percent",
    0.01: "a slip of the decimal point, or percent",
    1000.0: "kilo or milli",
    0.001: "kilo or milli",
    float(np.sqrt(3.0)): "values of a phase and of a line",
    float(1 / np.sqrt(3.0)): "values of a phase and of a line",
    3.0: "one phase and all three",
    1 / 3.0: "one phase and all three",
}
_NAMES = tuple(ENTRIES)
#: Where each number of the mended row stands -> what was exchanged.
_EXCHANGED = {
    (1, 0, 2, 3): ("dd", "dq"),
    (0, 1, 3, 2): ("qd", "qq"),
    (2, 1, 0, 3): ("dd", "qd"),
    (0, 3, 2, 1): ("dq", "qq"),
    (3, 1, 2, 0): ("dd", "qq"),
    (0, 2, 1, 3): ("dq", "qd"),
}
_EXCHANGED_TWICE = {
    (1, 0, 3, 2): "the columns d and q",
    (2, 3, 0, 1): "the rows d and q",
    (3, 2, 1, 0): "the axes d and q",
}


@dataclass(frozen=True)
class Mistake:
    """`entries` : that it spoils. `words` : what it looks like. `rank` : of two that explain as
    well the lower is likelier.
    """

    entries: tuple[str, ...]
    words: str
    rank: int


#: A mistake, and the row without it.
Mended = tuple[Mistake, np.ndarray]


def mended(row: np.ndarray) -> Iterator[Mended]:
    """Each mistake, and the row (4,) complex as it would be without it: of the whole row, of an
    entry, of a number.
    """
    yield from _of_the_row(row)
    for k, name in enumerate(_NAMES):
        yield from _of_an_entry(row, k, name)


def _of_the_row(row: np.ndarray) -> Iterator[Mended]:
    def of_all(words: str) -> Mistake:
        return Mistake(_NAMES, words, 0)

    for factor, why in FACTORS.items():
        yield of_all(f"all entries {_times(factor)}, {why}"), row / factor
    yield of_all("all entries with the other sign"), -row
    yield of_all("imaginary parts with the other sign"), row.conj()
    yield of_all("real parts with the other sign"), -row.conj()
    yield of_all("real and imaginary parts exchanged"), 1j * row.conj()
    for order, pair in _EXCHANGED.items():
        yield Mistake(pair, f"Y{pair[0]} and Y{pair[1]} exchanged", 1), row[list(order)]
    for order, what in _EXCHANGED_TWICE.items():
        yield of_all(f"{what} exchanged"), row[list(order)]


def _of_an_entry(row: np.ndarray, k: int, name: str) -> Iterator[Mended]:
    def instead(words: str, value: complex, rank: int) -> Mended:
        other = row.copy()
        other[k] = value
        return Mistake((name,), words, rank), other

    value = complex(row[k])
    real, imaginary = value.real, value.imag
    for factor, why in FACTORS.items():
        yield instead(f"Y{name} {_times(factor)}, {why}", value / factor, 2)
        yield instead(
            f"real part of Y{name} {_times(factor)}, {why}", complex(real / factor, imaginary), 3
        )
        yield instead(
            f"imaginary part of Y{name} {_times(factor)}, {why}",
            complex(real, imaginary / factor),
            3,
        )
    yield instead(f"Y{name} with the other sign", -value, 2)
    yield instead(f"real part of Y{name} with the other sign", complex(-real, imaginary), 3)
    yield instead(f"imaginary part of Y{name} with the other sign", complex(real, -imaginary), 3)
    yield instead(f"real and imaginary part of Y{name} exchanged", complex(imaginary, real), 2)


def _times(factor: float) -> str:
    return f"{factor:.4g} times too large" if factor > 1 else f"{1 / factor:.4g} times too small"
