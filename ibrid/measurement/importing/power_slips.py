"""A slip of the decimal point or the sign in p or q of a row, by which it becomes an operating
point of its own.

It stands at a frequency which another operating point lacks, and its p and q are that one's but for
the slip.
"""

import numpy as np

from ibrid.measurement.formats.grouping import rows_of_each
from ibrid.measurement.importing.foreign_part import Part
from ibrid.measurement.importing.import_account import Account

#: Rows of an operating point from which on others may belong to it, and how many these may be.
_MANY, _FEW = 8, 3
#: How near numbers must be that are the same but for a slip, as a part, and per unit.
_ALIKE, _NEAR = 0.02, 0.005
#: What a number is of the one that was meant.
_SLIPS = {
    -1.0: "the other sign",
    0.01: "a slip of the decimal point",
    0.1: "a slip of the decimal point",
    10.0: "a slip of the decimal point",
    100.0: "a slip of the decimal point",
}


def mind_slips(part: Part, powers: np.ndarray, first: np.ndarray, account: Account) -> None:
    """Remark on rows that likely belong to another operating point than their p and q say.

    Parameters
    ----------
    powers : (n, 3) p, q and v of each row, per unit.
    first : (n,) the first row of the operating point of each row.
    """
    amplitude, repeat = np.nan_to_num(part.amplitude).tolist(), np.nan_to_num(part.repeat).tolist()
    keys = list(zip(part.frequency.tolist(), amplitude, repeat, strict=True))
    points = rows_of_each(first.tolist())
    few = [k for k in range(len(keys)) if len(points[first[k]]) <= _FEW]
    for begin, rows in points.items():
        if len(rows) < _MANY:
            continue
        present = {keys[k] for k in rows}
        missing = [k for k in few if keys[k] not in present]
        slips = {
            k: slip
            for k in missing
            if (slip := _slip(powers[k], powers[begin], k, rows, points[first[k]]))
        }
        if len(slips) > _FEW:
            continue
        for k, slip in slips.items():
            shown = f"{part.frequency[k]:g} Hz"
            account.remark(
                f"{part.table.where} line {part.table.line[k]} is read as at {_words(powers[k])}, "
                f"and has {shown}, which the "
                f"{len(rows)} rows at {_words(powers[begin])} lack: is that {slip}? Then correct "
                "it, or leave the row out"
            )


def _slip(
    here: np.ndarray, there: np.ndarray, row: int, rows: np.ndarray, beside: np.ndarray
) -> str:
    """What makes p and q of a row from those of an operating point, in words; "" where it may be
    one of its own.

    rows, beside : of the operating point, and of that which the row has now.
    """
    same = np.abs(here - there) <= np.maximum(_ALIKE * np.abs(there), _NEAR)
    for k, role in enumerate("pq"):
        others = [n for n in range(len(same)) if n != k]
        meant = [
            slip
            for factor, slip in _SLIPS.items()
            if np.abs(here[k] - factor * there[k]) <= _ALIKE * abs(here[k])
        ]
        if same[others].all() and there[k] and meant:
            return f"{meant[0]} in {role}"
    within = rows[0] < row < rows[-1] and {row - 1, row + 1} <= {*rows.tolist()}
    return "a slip of p or q" if within and len(beside) == 1 else ""


def _words(powers: np.ndarray) -> str:
    return f"p={powers[0]:.3g} q={powers[1]:.3g}"
