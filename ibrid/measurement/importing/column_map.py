"""`--map freq=f,Ydd=ReYdd+jImYdd,p=P`: which columns hold what, where their names do not say it."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from ibrid.errors import SweepError, near
from ibrid.measurement.formats.csv_columns import ENTRIES
from ibrid.measurement.importing.column_words import unit_of

#: What can be mapped in a file that holds one entry, whose name says which.
OF_ONE_ENTRY = ("Y", "Z")
FREQUENCIES = ("freq", "omega")
_IN_EACH_FILE = (*OF_ONE_ENTRY, *FREQUENCIES)
#: What can be mapped.
ROLES = (
    *(*FREQUENCIES, "op", "p", "q", "v", "sigma", "repeat", "amplitude"),
    *(
        f"{word}{entry}"
        for word in ("sigma_", "Y", "Z")
        for entries in ENTRIES.values()
        for entry in entries
    ),
)
_FORMS = (
    "freq=f, p=0.8, Ydd=ReYdd+jImYdd (two columns), Ydd=Mag@Phase, Ydd=Y (complex), f[kHz] with a "
    "unit, #3 for the third"
)

#: Most characters of one item.
LONGEST = 4000


@dataclass(frozen=True)
class Source:
    """Where a number comes from: one or two columns, or a constant. `joined` : "" for one column,
    "j" for real and imaginary part, "@" for magnitude and phase. `unit` : in brackets behind the
    columns, "" where their names are to say it; `imaginary`,
    `angle` : the same of an imaginary part that has its own, and of a phase. `name` : of a constant
    beside the table.
    """

    columns: tuple[str, ...] = ()
    joined: str = ""
    unit: str = ""
    constant: float | None = None
    angle: str = ""
    name: str = ""
    imaginary: str = ""


def parse_map(
    texts: Iterable[str], known: Iterable[str], beside: Mapping[str, tuple[float, str]]
) -> dict[str, Source]:
    """What each role is made of. known : names of the columns. beside : numbers outside the table,
    by name, with their units. SweepError names the near ones.
    """
    columns = tuple(known)
    sources: dict[str, Source] = {}
    for role, value in _items(texts):
        if role in OF_ONE_ENTRY:
            raise SweepError(
                f"--map {role}=.. must be said of files with one entry each, whose names end with "
                f"it ({role}dd .. {role}qq); name the four: --map {role}dd=..,{role}dq=.."
            )
        if role not in ROLES:
            raise SweepError(f"--map: {role[:40]!r} cannot be mapped, {near(role, ROLES)}")
        sources[role] = _source(value, columns, beside, role)
    return sources


def parse_map_of_entry(texts: Iterable[str], known: Iterable[str]) -> dict[str, Source]:
    """What is said of the columns of a file with one entry: Y or Z and what it is made of
    (`Z=#2[dB]@#3[deg]`), and its frequencies.
    """
    return {
        role: _source(value, tuple(known), {}, role)
        for role, value in _items(texts)
        if role in _IN_EACH_FILE
    }


def without_map_of_entry(texts: Iterable[str]) -> tuple[str, ...]:
    """What is mapped beside that."""
    return tuple(f"{role}={value}" for role, value in _items(texts) if role not in _IN_EACH_FILE)


def _items(texts: Iterable[str]) -> Iterator[tuple[str, str]]:
    """(role, what it is made of) of each item; SweepError where one is not written so."""
    for text in texts:
        for item in re.findall(r'(?:"[^"]*"|\[[^\]]*\]|[^,]|,(?!\s*\w+\s*=))+', text):
            role, mark, value = (part.strip() for part in item.partition("="))
            if not mark or not value:
                raise SweepError(f"--map is written {_FORMS}; found {item.strip()[:60]!r}.")
            if len(item) > LONGEST:
                raise SweepError(
                    f"--map {role[:40]}=.. must have at most {LONGEST:,} characters; found "
                    f"{len(item):,}, name columns by their number, #3."
                )
            yield role, value


def _source(
    value: str, columns: tuple[str, ...], beside: Mapping[str, tuple[float, str]], role: str
) -> Source:
    name, unit = _column(value, columns)
    if name:
        return Source((name,), "", unit)
    for mark in re.finditer(r"\+j\*?|\+i|[@∠]", value):
        (first, unit), (other, behind) = (
            _column(value[: mark.start()], columns),
            _column(value[mark.end() :], columns),
        )
        if first and other:
            if mark[0] not in "@∠":
                return Source((first, other), "j", unit or behind, imaginary=behind if unit else "")
            turned = bool(unit and behind) or (unit_of(behind) or " ")[0].startswith("angle")
            return Source(
                (first, other),
                "@",
                unit or ("" if turned else behind),
                angle=behind if turned else "",
            )
    bare, unit = _unit_behind(value)
    if bare in beside:
        return Source((), "", unit or beside[bare][1], beside[bare][0], name=bare)
    try:
        return Source((), "", unit, float(bare))
    except ValueError:
        if role == "op":
            return Source((), "", value.strip('"'))
        close = near(value, (*columns, *beside))
        raise SweepError(
            f"--map {role}={value[:60]}: no such column, {close}; write {_FORMS}."
        ) from None


def _unit_behind(text: str) -> tuple[str, str]:
    bracket = re.fullmatch(r"(.+?)\s*\[([^\]]*)\]", text.strip())
    return (bracket[1], bracket[2]) if bracket and unit_of(bracket[2]) else (text.strip(), "")


def _column(text: str, columns: tuple[str, ...]) -> tuple[str, str]:
    """The column that a text names, by itself or as #3, and the unit in brackets behind it; "" for
    none.
    """
    for name, unit in ((text.strip(), ""), _unit_behind(text)):
        name = name.strip('"')
        if (
            re.fullmatch(r"#\d+", name)
            and name not in columns
            and 0 < int(name[1:]) <= len(columns)
        ):
            return columns[int(name[1:]) - 1], unit
        if name in columns:
            return name, unit
    return "", ""
