"""Magnitudes that may be decibels, and angles that may be radians, although nothing says so.

Law: the entries of a device are rational functions with common poles. Decibels taken as magnitudes
are none, so that a vector fit of the right reading leaves far less over.
"""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from ibrid.measurement.importing.column_map import Source
from ibrid.measurement.importing.column_numbers import largest_phase
from ibrid.measurement.importing.column_words import meaning_of, unit_of
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.import_account import Account
from ibrid.measurement.sweeps.vector_fit import FEWEST, best_fit

#: Whether numbers show decibels.
Seen = Literal["no", "perhaps", "likely"]
#: Magnitudes beyond are no decibels of any device.
_MOST_DECIBELS = 200.0
#: A reading is shown where its fit leaves at most this part over of what the other leaves.
_CLEARLY = 0.3
#: Of sequences, whose entries are no functions of real coefficients: magnitudes that span more are
#: no decibels.
_DECADES = 1e3
#: Most rows that are looked at.
_ROWS = 60
_TURN = 2 * np.pi


def decibels_seen(
    sources: Sequence[Source], frequency: np.ndarray, values: np.ndarray, letter: str, frame: str
) -> Seen:
    """Whether the numbers of magnitudes that say no unit show decibels: "no", "perhaps" where they
    show neither, "likely".

    sources : of the entries. values : complex, (K, 4), with the magnitudes as they stand. frame :
    dq, pn or positive.
    """
    unsaid = all(
        source.joined == "@"
        and not source.unit
        and unit_of(meaning_of(source.columns[0]).unit) is None
        for source in sources
    )
    size = np.abs(values)
    largest = np.nanmax(size, initial=0.0)
    if not unsaid or largest > _MOST_DECIBELS:
        return "no"
    if frame == "dq":
        return _nearer_reading(frequency, values, letter, lambda size: 10 ** (size / 20))
    return "perhaps" if np.nanmin(size, initial=np.inf) > largest / _DECADES else "no"


def ask_decibels(sources: Sequence[Source], letter: str, account: Account) -> None:
    """Ask whether magnitudes are decibels of a unit that is said."""
    unit = {"Y": "S", "Z": "ohm"}[letter]
    first, angle = sources[0].columns
    account.ask(
        f"whether its magnitudes ({first} and others) are {unit} or per unit, or decibels of it",
        f"--unit dB{unit}",
        f'[{unit}] or [pu] to the magnitudes: --map "{letter}dd={first}[{unit}]@{angle},.."',
    )


def mind_decibels_of_power(
    sources: Sequence[Source],
    frequency: np.ndarray,
    values: np.ndarray,
    letter: str,
    account: Account,
) -> None:
    """Remark where decibels are probably 10 log10 of the magnitudes, not 20: they are far nearer to
    a rational function once they are doubled.

    values : complex, (K, 4), in dq, with 20 log10.
    """
    units = [
        unit_of(source.unit or meaning_of(source.columns[0]).unit)
        for source in sources
        if source.joined == "@"
    ]
    if len(units) < 4 or any(unit is None or unit[0] != "decibel" for unit in units):
        return
    if _nearer_reading(frequency, values, letter, np.square) == "likely":
        account.remark(
            "its decibels are probably 10 log10 of the magnitudes, where 20 log10 is read: only "
            "once they are doubled are the entries those of a linear device; double them in the "
            "file"
        )


def _nearer_reading(
    frequency: np.ndarray,
    values: np.ndarray,
    letter: str,
    reread: Callable[[np.ndarray], np.ndarray],
) -> Seen:
    """Whether the first run of rows is far nearer to a proper rational function as it stands, or
    with its magnitudes read anew; impedances, which grow with frequency, as their inverses.
    """
    turn = np.flatnonzero(np.diff(frequency) <= 0)
    rows = np.arange(turn[0] + 1 if len(turn) else len(frequency))
    rows = rows[np.isfinite(values[rows]).all(axis=1) & (frequency[rows] > 0)]
    if len(rows) < FEWEST:
        return "perhaps"
    rows = rows[:: -(-len(rows) // _ROWS)]
    hertz, matrix = frequency[rows], values[rows].reshape(-1, 2, 2)
    readings = [matrix, np.exp(1j * np.angle(matrix)) * reread(np.abs(matrix))]
    if any((np.linalg.det(one) == 0).any() for one in readings):
        return "perhaps"
    if letter == "Z":
        readings = [np.linalg.inv(one) for one in readings]
    left, other = (np.sqrt(best_fit(hertz, one).variance) for one in readings)
    if left <= _CLEARLY * other:
        return "no"
    return "likely" if other <= _CLEARLY * left else "perhaps"


def ask_radians(
    table: ForeignTable, sources: Sequence[Source], letter: str, account: Account
) -> None:
    """Ask whether angles whose names say degrees are radians, where none of all entries is beyond a
    turn in radians.
    """
    polar = [source for source in sources if source.joined == "@" and not source.angle]
    angles = [source.columns[1] for source in polar]
    if len(angles) < 4 or any(meaning_of(name).dimension != "angle" for name in angles):
        return
    largest = max(largest_phase(table.columns[name]) for name in angles)
    if 0 < largest <= _TURN:
        place = f'--map "{letter}dd={polar[0].columns[0]}@{angles[0]}'
        account.ask(
            f"whether its angles are radians, since none is beyond {largest:.3g} while their names "
            "say degrees",
            f'{place}[rad],.."',
            f'{place}[deg],.."',
        )
