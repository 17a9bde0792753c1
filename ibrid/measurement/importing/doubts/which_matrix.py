"""Which matrix the columns of a table hold: words behind Y and Z, and both beside each other."""

from collections.abc import Mapping, Sequence

import numpy as np

from ibrid.measurement.formats.csv_columns import ENTRIES
from ibrid.measurement.importing.column_map import Source
from ibrid.measurement.importing.column_numbers import complex_numbers
from ibrid.measurement.importing.column_words import is_known_word, meaning_of
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.import_account import Account

#: How near the product of Y and Z must be to the same multiple of one, as a part.
_INVERSE = 0.02


def mind_words(entries: Sequence[str], sources: Mapping[str, Source], account: Account) -> None:
    """Remark on a word behind Y or Z that may say more than whose matrix it is."""
    names = [column for entry in entries for column in sources[entry].columns]
    for word, name in {meaning_of(name).of: name for name in reversed(names)}.items():
        if word == "inv":
            account.remark(f"{name}: taken as of the inverter, not as an inverse")
        elif not is_known_word(word):
            account.remark(f"{name}: {word!r} is not known, taken as of the inverter")


def ask_which_matrix(
    table: ForeignTable,
    sources: Mapping[str, Source],
    frame: str,
    admittance: np.ndarray,
    account: Account,
) -> None:
    """Ask which matrix is meant where impedances stand beside the admittances and are not their
    inverses, whatever the units.

    admittance : (K, 4), row by row, in any unit.
    """
    names = [f"Z{entry}" for entry in ENTRIES.get(frame, ())]
    if not names or not {*names, *(f"Y{name[1:]}" for name in names)} <= sources.keys():
        return
    if any(sources[name].joined == "@" for name in names):
        return  # whose decibels and angles are asked for where they are read
    values = [
        complex_numbers(table, sources[name], account, unsaid_decibel=False)[0] for name in names
    ]
    product = admittance.reshape(-1, 2, 2) @ np.stack(values, axis=-1).reshape(-1, 2, 2)
    size = np.nanmedian(np.trace(product, axis1=1, axis2=2).real) / 2
    if not np.nanmax(np.abs(product - size * np.eye(2))) < _INVERSE * abs(size):
        account.ask(
            "which of its matrices is meant, since Z is not the inverse of Y",
            "--quantity Y",
            "--quantity Z",
        )
