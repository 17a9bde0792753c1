"""Magnitudes that may be decibels, and angles that may be radians, although nothing says so.

Law: the entries of a device are rational functions with common poles. Decibels taken as magnitudes
are none, so that a vector fit of the right reading leaves far less over.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.measurement.importing.column_map import Source
from ibrid.measurement.importing.column_numbers import largest_phase
from ibrid.measurement.importing.column_words import meaning_of, unit_of
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.import_account import Account
from ibrid.measurement.sweeps.vector_fit import FEWEST, best_fit

#: Magnitudes beyond are no decibels of any device.
_MOST_DECIBELS = 200.0
#: Magnitudes are no decibels where their fit leaves at most this part over of what the other
#: leaves.
_CLEARLY = 0.3
#: Most rows that are looked at.
_ROWS = 60
_TURN = 2 * np.pi


def ask_decibels(
    table: ForeignTable,
    sources: Sequence[Source],
    frequency: np.ndarray,
    values: np.ndarray,
    letter: str,
    account: Account,
) -> None:
    """Ask whether magnitudes that say no unit are decibels, unless the numbers show that they are
    none.

    sources : of the entries. values : complex, (K, 4), with the magnitudes as they stand.
    """
    unsaid = [
        source.joined == "@"
        and not source.unit
        and unit_of(meaning_of(source.columns[0]).unit) is None
        for source in sources
    ]
    size = np.abs(values[:, unsaid])
    if not all(unsaid) or np.nanmax(size, initial=0.0) > _MOST_DECIBELS:
        return
    if values.shape[1] == 4 and _are_magnitudes(frequency, values, letter):
        return
    unit = {"Y": "S", "Z": "ohm"}[letter]
    first = sources[0]
    account.ask(
        f"whether its magnitudes ({first.columns[0]} and others) are {unit} or per unit, or "
        "decibels of it",
        f"--unit dB{unit}",
        f"[{unit}] or [pu] to the magnitudes: --map "
        f'"{letter}dd={first.columns[0]}[{unit}]@{first.columns[1]},.."',
    )


def _are_magnitudes(frequency: np.ndarray, values: np.ndarray, letter: str) -> bool:
    """Whether the first run of rows is far nearer to a proper rational function than its decibels
    are; impedances, which grow with frequency, as their inverses.
    """
    turn = np.flatnonzero(np.diff(frequency) <= 0)
    rows = np.arange(turn[0] + 1 if len(turn) else len(frequency))
    rows = rows[np.isfinite(values[rows]).all(axis=1) & (frequency[rows] > 0)]
    if len(rows) < FEWEST:
        return False
    rows = rows[:: -(-len(rows) // _ROWS)]
    hertz, matrix = frequency[rows], values[rows].reshape(-1, 2, 2)
    decibels = np.exp(1j * np.angle(matrix)) * 10 ** (np.abs(matrix) / 20)
    readings = [matrix, decibels]
    if any((np.linalg.det(one) == 0).any() for one in readings):
        return False
    if letter == "Z":
        readings = [np.linalg.inv(one) for one in readings]
    left, other = (np.sqrt(best_fit(hertz, one).variance) for one in readings)
    return bool(left <= _CLEARLY * other)


def ask_radians(table: ForeignTable, sources: Sequence[Source], account: Account) -> None:
    """Ask whether angles whose names say degrees are radians, where none of all entries is beyond a
    turn in radians.
    """
    polar = [source for source in sources if source.joined == "@" and not source.angle]
    angles = [source.columns[1] for source in polar]
    if len(angles) < 4 or any(meaning_of(name).dimension != "angle" for name in angles):
        return
    largest = max(largest_phase(table.columns[name]) for name in angles)
    if 0 < largest <= _TURN:
        place = f'--map "Ydd={polar[0].columns[0]}@{angles[0]}'
        account.ask(
            f"whether its angles are radians, since none is beyond {largest:.3g} while their names "
            "say degrees",
            f'{place}[rad],.."',
            f'{place}[deg],.."',
        )
