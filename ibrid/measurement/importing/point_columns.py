"""Which columns of a table name its operating points: by their names, unless they number rows or
frequencies; by values.
"""

import re
from collections.abc import Collection, Sequence

import numpy as np

from ibrid.errors import SweepError, near
from ibrid.measurement.importing.column_words import meaning_of
from ibrid.measurement.importing.foreign_table import ForeignTable


def columns_of_points(
    table: ForeignTable, frequency: np.ndarray, said: Collection[str]
) -> tuple[str, ...]:
    """The columns that tell operating points apart; those that add nothing to others before them
    are left out.

    One whose every value stands at one frequency numbers rows or frequencies (id, point) and names
    none, unless all have one.
    said : names that the user gives to operating points: a column that holds all of them names the
    points, whatever it is called.
    """
    for name in table.columns:
        if said and set(said) <= set(names_in(table, (name,)).tolist()):
            return (name,)
    chosen: tuple[str, ...] = ()
    for name in table.columns:
        if meaning_of(name).role != "op" or _empty_cells(table, name).all():
            continue
        if _numbers_rows(names_in(table, (name,)), frequency):
            continue
        more = (*chosen, name)
        adds = len(set(names_in(table, more).tolist())) > (
            len(set(names_in(table, chosen).tolist())) if chosen else 0
        )
        if adds and not (chosen and _numbers_rows(names_in(table, more), frequency)):
            chosen = more
    return chosen


def names_in(table: ForeignTable, columns: Sequence[str]) -> np.ndarray:
    """(n,) the names that the values of some columns make together."""
    cells = [table.columns[name].tolist() for name in columns]
    words = [
        [f"{cell:g}" if isinstance(cell, float) else str(cell) for cell in column]
        for column in cells
    ]
    return np.array([tidy_name("_".join(row)) for row in zip(*words, strict=True)], dtype=object)


def require_named(said: str | None, names: np.ndarray, column: str) -> None:
    """SweepError where the user names an operating point that the column of their names does not
    hold.
    """
    held = list(dict.fromkeys(names.tolist()))
    if said and said not in held and tidy_name(said) not in held:
        raise SweepError(
            f"--op {said}: no operating point is called so in {column}; {near(said, held)}"
        )


def require_names(table: ForeignTable, columns: Sequence[str], rows: np.ndarray) -> None:
    """SweepError where a row has no name of its operating point. rows : (n,) those with numbers."""
    empty = rows & np.all([_empty_cells(table, name) for name in columns], axis=0)
    if empty.any():
        place = table.place(int(empty.argmax()), columns[0])
        raise SweepError(
            f"{place} must name an operating point; found an empty cell, write the name in every "
            "row."
        )


def _empty_cells(table: ForeignTable, name: str) -> np.ndarray:
    return np.array([str(cell).strip() in ("", "nan") for cell in table.columns[name].tolist()])


def tidy_name(name: str) -> str:
    """A name that needs no quotes on a command line."""
    return re.sub(r"[\s,;]+", "_", name.strip()).strip("_#") or "op"


def _numbers_rows(names: np.ndarray, frequency: np.ndarray) -> bool:
    """Whether every value stands at one frequency alone, while the table has several."""
    pairs = set(zip(names.tolist(), frequency.tolist(), strict=True))
    several = len(set(frequency.tolist())) > 1
    return several and len(pairs) == len(set(names.tolist())) > 1
