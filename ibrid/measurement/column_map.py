"""`--map freq=f,Ydd=ReYdd+jImYdd,p=P`: which columns hold what, where their names do not say it."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from ibrid.errors import SweepError, near
from ibrid.measurement.column_words import unit_of

_ENTRIES = ("dd", "dq", "qd", "qq", "pp", "pn", "np", "nn")
#: What can be mapped.
ROLES = (
    *("freq", "omega", "op", "p", "q", "v", "sigma", "repeat", "amplitude"),
    *(f"sigma_{entry}" for entry in _ENTRIES),
    *(f"{letter}{entry}" for letter in "YZ" for entry in _ENTRIES),
)
_FORMS = "freq=f, p=0.8, Ydd=ReYdd+jImYdd (two columns), Ydd=Mag@Phase, Ydd=Y (complex), f[kHz] with a unit, #3 for the third"


@dataclass(frozen=True)
class Source:
    """Where a number comes from: one or two columns, or a constant. `joined` : "" for one column, "j" for real and imaginary
    part, "@" for magnitude and phase. `unit` : in brackets behind the columns, "" where their names are to say it."""

    columns: tuple[str, ...] = ()
    joined: str = ""
    unit: str = ""
    constant: float | None = None


def parse_map(texts: Iterable[str], known: Iterable[str]) -> dict[str, Source]:
    """What each role is made of. known : names of the columns. SweepError names the near ones."""
    columns = tuple(known)
    found: dict[str, Source] = {}
    for text in texts:
        for item in re.findall(r'(?:"[^"]*"|\[[^\]]*\]|[^,])+', text):
            role, mark, value = (part.strip() for part in item.partition("="))
            if not mark or not value:
                raise SweepError(f"--map is written {_FORMS}; found {item.strip()[:60]!r}.")
            if role not in ROLES:
                raise SweepError(f"--map: {role[:40]!r} cannot be mapped, {near(role, ROLES)}")
            found[role] = _source(value, columns, role)
    return found


def _source(value: str, columns: tuple[str, ...], role: str) -> Source:
    if _column(value, columns):
        return Source((_column(value, columns),))
    unit = ""
    bracket = re.fullmatch(r"(.+?)\s*\[([^\]]*)\]", value)
    if bracket and unit_of(bracket[2]):
        value, unit = bracket[1], bracket[2]
    for joined in ("+j*", "+j", "+i", "@", "∠"):
        for split in re.finditer(re.escape(joined), value):
            pair = _column(value[: split.start()], columns), _column(value[split.end() :], columns)
            if all(pair):
                return Source(pair, "@" if joined in "@∠" else "j", unit)
    if _column(value, columns):
        return Source((_column(value, columns),), "", unit)
    try:
        return Source((), "", unit, float(value))
    except ValueError:
        if role == "op":
            return Source((), "", value.strip('"'))
        raise SweepError(
            f"--map {role}={value[:60]}: no such column, {near(value, columns)}; write {_FORMS}."
        ) from None


def _column(text: str, columns: tuple[str, ...]) -> str:
    """The column that a text names, by itself or as #3; "" for none."""
    name = text.strip().strip('"')
    if re.fullmatch(r"#\d+", name) and name not in columns and 0 < int(name[1:]) <= len(columns):
        return columns[int(name[1:]) - 1]
    return name if name in columns else ""
