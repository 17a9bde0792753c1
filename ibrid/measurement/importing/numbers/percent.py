"""Numbers that a workbook shows in percent, in columns and beside names that say % themselves: both
together scale once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ibrid.measurement.importing.column_words import without_unit
from ibrid.measurement.importing.foreign_table import ForeignTable

Rows = list[tuple[int, list[str]]]


def shown_beside_names(rows: Rows, shown: set[tuple[int, int]]) -> Rows:
    """The rows with numbers behind a name in %, such as `P [%]`, as they are shown.

    shown : row and column of the cells that are shown in percent.
    """
    if not shown:
        return rows
    changed: Rows = []
    for row, cells in rows:
        before = ""
        new = []
        for column, cell in enumerate(cells):
            beside = (row, column) in shown and without_unit(before)[1] == "%"
            new.append(f"{100 * float(cell):.15g}" if beside and cell else cell)
            before = cell or before
        changed.append((row, new))
    return changed


def scaled_once(
    table: ForeignTable, shown: set[tuple[int, int]], places: Sequence[int]
) -> ForeignTable:
    """The table with columns in % as their cells show them; others keep their numbers, and those
    that are shown in percent throughout are remembered.

    places : the column of the sheet of each column.
    """
    if not shown:
        return table
    columns, remarks, percent = dict(table.columns), list(table.remarks), []
    for (name, values), place in zip(table.columns.items(), places, strict=True):
        mask = np.array([(row, place) in shown for row in table.line.tolist()])
        if values.dtype.kind not in "fc" or not mask.any():
            continue
        if without_unit(name)[1] == "%":
            columns[name] = np.where(mask, 100 * values, values)
            remarks.append(_words(name, values[mask]))
        elif mask[np.isfinite(values)].all():
            percent.append(name)
    return replace(table, columns=columns, remarks=tuple(remarks), percent=frozenset(percent))


def as_shown(table: ForeignTable, names: Iterable[str]) -> ForeignTable:
    """The table with columns that are said to be in % as a workbook shows them."""
    scaled = [name for name in dict.fromkeys(names) if name in table.percent]
    if not scaled:
        return table
    words = [_words(name, table.columns[name]) for name in scaled]
    return replace(
        table,
        columns={**table.columns, **{name: 100 * table.columns[name] for name in scaled}},
        remarks=(*table.remarks, *words),
        percent=table.percent - {*scaled},
    )


def _words(name: str, values: np.ndarray) -> str:
    first = values[np.isfinite(values)][:1]
    example = f", {first[0]:.4g} as {100 * first[0]:.4g} %" if len(first) else ""
    return f"{name}: its cells are formatted in percent and read as they are shown{example}"
