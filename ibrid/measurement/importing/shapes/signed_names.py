"""Columns whose names begin with a minus, as `-Im(Zdd)` of impedance spectroscopy and `-ia` of
recorders that count the current the other way.
"""

import re
from dataclasses import replace

from ibrid.errors import SweepError, some
from ibrid.measurement.importing.column_words import meaning_of
from ibrid.measurement.importing.foreign_table import ForeignTable

#: Before the first letter of a name, or of what stands in its brackets.
_MINUS = re.compile(r"(?:^|\()\s*[-−–]\s*(?=[^\W\d_])")
#: What a remark says of columns that were read with the other sign.
NEGATED = "read with the other sign, as the minus in their names says"


def unsigned(name: str) -> str:
    """The name without the minus that `without_signs` takes from it."""
    return _MINUS.sub(lambda minus: "(" if "(" in minus[0] else "", name)


def without_signs(table: ForeignTable) -> ForeignTable:
    """The table with the numbers that the names mean without their minus.

    Raises SweepError where a magnitude is said to be negative, or one name has two signs.
    """
    signed = {name: len(_MINUS.findall(name)) for name in table.columns}
    negated = [
        name for name, signs in signed.items() if signs and table.columns[name].dtype.kind in "fc"
    ]
    if not negated:
        return table
    for name in negated:
        if signed[name] > 1 or meaning_of(name).part == "mag":
            raise SweepError(
                f"{table.where}: the sign in {name[:60]} cannot be understood; rename the column."
            )
    columns = {
        name: -values if name in negated else values for name, values in table.columns.items()
    }
    remark = f"{some(negated)}: {NEGATED}"
    return replace(table, columns=columns, remarks=(*table.remarks, remark))
