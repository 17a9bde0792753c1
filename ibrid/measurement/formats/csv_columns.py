"""Column names of a sweep CSV: which are needed, which may be there, and what a wrong one probably
meant.
"""

from dataclasses import dataclass

from ibrid.errors import SweepError, near
from ibrid.measurement.conventions.conversions import Quantity

SETPOINT = ("op", "p", "q", "freq_hz")
OPTIONAL = ("v", "sigma", "repeat", "amplitude")
ENTRIES = {"dq": ("dd", "dq", "qd", "qq"), "pn": ("pp", "pn", "np", "nn")}


@dataclass(frozen=True)
class Columns:
    """Where each column is and what the matrix columns hold.

    place : column name -> index.
    matrix : the (real, imaginary) column names in the order 11, 12, 21, 22.
    sigma : none, ("sigma",) or four names.
    """

    count: int
    place: dict[str, int]
    quantity: Quantity
    matrix: tuple[tuple[str, str], ...]
    sigma: tuple[str, ...]


def columns_of(names: list[str], where: str) -> Columns:
    """Understand a line of column names; SweepError, beginning with `where`, names what is wrong
    and what is near.
    """
    if len(names) == 1:
        others = "semicolons" if ";" in names[0] else "tabs" if "\t" in names[0] else "separators"
        raise SweepError(
            f"{where} must hold column names separated by commas, beginning with op,p,q,freq_hz; "
            f"found {names[0][:60]!r}, replace the {others}, or let ibrid import read it."
        )
    require_once(names, where)
    families = [(Quantity(letter, frame == "pn"), frame) for frame in ENTRIES for letter in "YZ"]
    quantity, frame = max(
        families,
        key=lambda one: sum(part in names for pair in _matrix_columns(*one) for part in pair),
    )
    matrix = _matrix_columns(quantity, frame)
    sigma = tuple(f"sigma_{entry}" for entry in ENTRIES[frame])
    needed = [*SETPOINT, *(part for pair in matrix for part in pair)]
    known = {*needed, *OPTIONAL, *sigma}
    wrong = [name for name in names if name not in known]
    missing = [name for name in needed if name not in names]
    if missing:
        raise SweepError(f"{where}: column {missing[0]} is missing; {_instead(missing, wrong)}")
    if wrong:
        raise SweepError(
            f"{where}: column {wrong[0][:40]!r} is not known, {near(wrong[0], known)}; rename or "
            "remove it."
        )
    given = [name for name in sigma if name in names]
    if given and ("sigma" in names or len(given) < 4):
        raise SweepError(
            f"{where}: the noise must be one column sigma or the four columns {', '.join(sigma)}; "
            f"found {', '.join(given)}{' and sigma' if 'sigma' in names else ''}."
        )
    return Columns(
        count=len(names),
        place={name: k for k, name in enumerate(names)},
        quantity=quantity,
        matrix=matrix,
        sigma=tuple(given) or (("sigma",) if "sigma" in names else ()),
    )


def require_once(names: list[str], where: str) -> None:
    """Raise SweepError for a name that two columns have."""
    if twice := [name for k, name in enumerate(names) if name in names[:k]]:
        raise SweepError(
            f"{where}: column {twice[0]!r} must be there once; found it twice, remove one."
        )


def _matrix_columns(quantity: Quantity, frame: str) -> tuple[tuple[str, str], ...]:
    letter = quantity.letter
    return tuple((f"{letter}{entry}_re", f"{letter}{entry}_im") for entry in ENTRIES[frame])


def _instead(missing: list[str], wrong: list[str]) -> str:
    """What stands in the place of a missing column, if something does."""
    if {"record", "t"} <= set(wrong):
        return (
            "the file holds records of events, where a sweep is needed; inspect, playback, "
            "evaluate, gap and search take them."
        )
    if len(missing) >= 8:
        return (
            "the columns are op,p,q,freq_hz and Ydd_re,Ydd_im,Ydq_re .. Yqq_im (or Zdd_re .., "
            "Ypp_re .., Zpp_re ..); "
            "ibrid import reads other tables."
        )
    if wrong:
        return (
            f"found {', '.join(repr(name[:40]) for name in wrong[:4])}, rename the one that holds "
            "it."
        )
    return f"add it{'' if len(missing) == 1 else ' (and ' + ', '.join(missing[1:]) + ')'}."
