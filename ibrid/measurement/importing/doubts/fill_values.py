"""Rows in which a number stands for what was not measured, such as -999 or 1e30, in all entries."""

from collections.abc import Sequence

import numpy as np

from ibrid.errors import some
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.import_account import Account
from ibrid.measurement.sweeps.quantities import counted

#: Sizes of numbers that programs write for what was not measured, and that from which on every
#: number is one, whatever the unit.
_NINES, _NEVER_MEASURED = (999.0, 9999.0, 99999.0, 999999.0), 1e15


def mind_fill_values(table: ForeignTable, columns: Sequence[str], account: Account) -> None:
    """Remark on rows with the same such number in all entries; they are kept.

    columns : of the entries, real and imaginary parts, magnitudes and angles, or complex numbers.
    """
    written = [np.asarray(table.columns[name]) for name in dict.fromkeys(columns)]
    if len(written) < 2 or any(column.dtype.kind not in "fc" for column in written):
        return
    parts = np.abs([np.real(column) for column in written])
    imaginary = np.abs([np.imag(column) for column in written])
    size = parts[0]
    filled = (parts == size).all(axis=0) & ((imaginary == size) | (imaginary == 0)).all(axis=0)
    filled &= np.isin(size, _NINES) | (size >= _NEVER_MEASURED)
    rows = np.flatnonzero(filled)
    if not len(rows):
        return
    value = np.real(written[0])[rows[0]]
    lines = some([f"line {table.line[row]}" for row in rows])
    account.remark(
        f"{counted(len(rows), 'row')} of {table.where} ({lines}) with {value:g} in all entries, "
        "which may stand for what was not measured: empty these cells, or leave the rows out"
    )
