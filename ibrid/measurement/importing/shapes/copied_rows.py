"""Rows of a table that stand in it twice, digit by digit."""

from dataclasses import replace

import numpy as np

from ibrid.errors import some
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.sweeps.quantities import counted

#: Part of the rows from which on copies are a second run, of which somebody else decides.
_A_RUN = 0.25


def without_copied_rows(table: ForeignTable) -> ForeignTable:
    """The table without rows that repeat another one in every column; a remark names them."""
    keys = list(zip(*(column.tolist() for column in table.columns.values()), strict=True))
    first = {key: row for row, key in reversed(list(enumerate(keys)))}
    copies = [row for row, key in enumerate(keys) if first[key] != row]
    if not copies or len(copies) >= _A_RUN * len(keys):
        return table
    lines = some([f"line {table.line[row]}" for row in copies], 5)
    remark = f"{counted(len(copies), 'row')} left out, the same as one before: {lines}"
    kept = np.setdiff1d(np.arange(len(keys)), copies)
    return replace(
        table,
        columns={name: column[kept] for name, column in table.columns.items()},
        line=table.line[kept],
        remarks=(*table.remarks, remark),
    )
