"""In which unit the frequencies of a table are: as their name, what stands beside them or, against
both, their numbers say.
"""

import re
from collections.abc import Iterable, Mapping

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.importing.column_map import Source
from ibrid.measurement.importing.column_words import letters_of, meaning_of, unit_of
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.import_account import Account
from ibrid.measurement.importing.told import F0_TOLD

#: Letters of the name of what holds the unit: FrequencyUnit, freq_unit, unit of frequency,
#: Frequenzeinheit.
_FREQUENCY = (
    r"(f|fr|freq|frequency|frequencies|frequenz|frequence|frequenza|frecuencia|w|omega|ω|频率)"
)
_UNIT_OF = r"(units?|einheit|unite|unidad)(of|der|de|dela)?(the)?"
_KEY = re.compile(rf"{_FREQUENCY}s?(units?|einheit|单位)|{_UNIT_OF}{_FREQUENCY}(en|s)?")
_PAIR = re.compile(r"([^\W\d][^:=\n]{0,80}?)\s*[:=]\s*['\"]?([^\d'\",;\n][^'\",;\n]*)")
#: What speaks of rad/s, or of kHz, in any sentence beside a table.
_SPEAKS = {
    "rad/s": re.compile(
        r"(?<![^\W\d_])[kM]?rad(?:ian)?s?(?:\s?/\s?|\s?per\s|[\s·*_.]*(?=s(?:ec)?\s?(?:\^|\*\*)?\s?[-−⁻]))(?:s|sec|seconds?)(?![^\W\d_])"
        r"|kreisfrequenz|angular freq|pulsation|frecuencia angular|pulsazion|角频率",
        re.I,
    ),
    "kHz": re.compile(r"(?<![^\W\d_])khz(?![^\W\d_])", re.I),
}
#: Numbers above are no kHz: no inverter is scanned there.
_HIGHEST_KHZ = 200.0
_KNOWN = "Hz, kHz, MHz, GHz, rad/s, krad/s, rad/minute, rad/TimeUnit, cycles/s or rpm"
_TIMES = {"second": 1.0, "minute": 60.0, "hour": 3600.0, "millisecond": 1e-3, "microsecond": 1e-6}
#: How near the middle of what turns d and q is to omega_0, and how near each of its numbers, where
#: f is in rad/s.
_NEAR_F0, _STEADY = 0.05, 0.2

#: What a unit measures, "frequency" or "angular frequency", and its size in Hz or rad/s.
Measure = tuple[str, float]


def in_hertz(
    table: ForeignTable, source: Source, account: Account, *, angular: bool
) -> tuple[np.ndarray, bool]:
    """The frequencies of a column in Hz, and whether nothing says that they are.

    In this order: the unit that the map says; that of the column's name, and of a key beside the
    table, which must agree; and `angular`, whether the name is that of an angular frequency (w,
    omega). Sentences beside it decide nothing.

    Raises SweepError where keys contradict each other; asks where name and key do.
    """
    name = source.columns[0]
    meaning = meaning_of(name)
    mapped = (measure_of(source.unit), source.unit) if source.unit else None
    named = ((meaning.dimension, meaning.factor), "") if meaning.dimension else None
    keyed = None if mapped else measure_keyed(table.notes, table.columns, name, where=table.where)
    if not mapped and named and keyed and named[0] != keyed[0]:
        _ask_unit(f"its name says {meaning.unit}, and beside it stands {keyed[1]}", source, account)
    said = mapped or named or keyed
    measure, words = said or (("angular frequency" if angular else "frequency", 1.0), "")
    if measure is None:
        raise SweepError(
            f"{table.where}: {name} must be in Hz or rad/s, also with k; found {source.unit}."
        )
    radians = measure[0] == "angular frequency"
    unsaid = not said and not angular
    of_radians = "krad/s" if measure[1] == 1e3 else "rad/s"
    shown = "Hz, as nothing says otherwise" if unsaid else of_radians if radians else "Hz"
    account.read(
        "frequency", name, f"{shown} ({words} stands beside it)" if words and not mapped else shown
    )
    return table.columns[name] * measure[1] / (2 * np.pi if radians else 1.0), unsaid


def doubt_hertz(
    table: ForeignTable,
    source: Source,
    frequency: np.ndarray,
    matrix: np.ndarray | None,
    f0_hz: float | None,
    account: Account,
) -> None:
    """Ask for the unit of frequencies that are Hz for want of a word, where numbers or any word
    beside them speak of another.

    matrix : (n, 2, 2) in dq, None: another frame.
    """
    whole = np.isfinite(frequency)
    if matrix is not None:
        whole &= np.isfinite(matrix).all(axis=(1, 2))
        matrix = matrix[whole]
    nominal = (f0_hz,) if f0_hz else (50.0, 60.0)
    why = numbers_show_radians(frequency[whole], matrix, nominal) if whole.any() else ""
    if not why and any(letters_of(name).startswith("responsedata") for name in table.columns):
        why = "MATLAB keeps those of a model in rad/s unless its FrequencyUnit says otherwise"
    if why:
        _ask_unit(why, source, account)
        return
    units = {}
    if not numbers_show_hertz(frequency[whole], matrix, nominal):
        units = units_spoken_of(table.notes, table.columns)
    if np.abs(frequency[whole]).max(initial=0.0) > _HIGHEST_KHZ:
        units.pop("kHz", None)
    if units:
        _ask_unit(f"beside them stands {next(iter(units.values()))!r}", source, account, *units)


def _ask_unit(why: str, source: Source, account: Account, *units: str) -> None:
    column = f"--map freq={source.columns[0]}"
    answers = (*(units or ("rad/s",)), "Hz")
    account.ask(f"the unit of the frequencies ({why})", *(f"{column}[{unit}]" for unit in answers))


def measure_of(text: str) -> Measure | None:
    """Of a unit of frequency as programs and colleagues write it: kHz, rad/s, rad/TimeUnit,
    cycles/s, rpm; None for no such.
    """
    pressed = " ".join(text.split())
    word = re.sub(" ?(/|per) ?", "/", pressed.strip("[]()").lower())
    whole = re.fullmatch(r"(k?)(rad|radian|radians|cycle|cycles)/(\w+?)s?", word)
    if whole and (whole[3] in _TIMES or whole[3] in ("", "sec", "timeunit")):
        size = (1e3 if whole[1] else 1.0) / _TIMES.get(whole[3], 1.0)
        return "angular frequency" if whole[2].startswith("rad") else "frequency", size
    if word in ("rpm", "r/min"):
        return "frequency", 1 / 60
    known = unit_of(text.strip())
    if known and known[0] in ("frequency", "angular frequency"):
        return known
    return ("angular frequency", 1.0) if known and known[0] == "angle in radians" else None


def measure_keyed(
    notes: Iterable[str], columns: Mapping[str, np.ndarray], name: str = "", *, where: str
) -> tuple[Measure, str] | None:
    """What a key beside a table, or a column that repeats it, says: FrequencyUnit, also MATLAB's
    rad/TimeUnit; and its words.

    name : of the column of frequencies, which is a key too: `tone: rad/s`, `unit of tone = rad/s`,
    `tone [rad/s], ..`.

    Raises SweepError, which begins with `where`, where two contradict each other, or a key such as
    FrequencyUnit names no unit.
    """
    notes = list(notes)
    pairs = [(letters_of(key), value) for note in notes for key, value in _PAIR.findall(note)]
    own = re.escape(letters_of(name))
    is_key = re.compile(rf"{_KEY.pattern}|{own}(units?|einheit)?|{_UNIT_OF}{own}") if own else _KEY
    if name:
        bracket = re.compile(rf"(?:^|[,;|])[\W_]{{0,20}}{re.escape(name)}\s*[\[(]([^\])\d]+)[\])]")
        pairs += [(own, value) for note in notes for value in bracket.findall(note)]
    pairs += [(letters_of(column), text) for column, text in _repeated_texts(columns).items()]
    time_unit = next((value.strip() for key, value in pairs if key == "timeunit"), "second")
    keyed: dict[Measure, str] = {}
    for key, value in pairs:
        measure = (
            measure_of(re.sub("timeunit", time_unit, value, flags=re.I))
            if is_key.fullmatch(key)
            else None
        )
        if measure:
            keyed[measure] = value.strip()
        elif _KEY.fullmatch(key):
            raise SweepError(
                f"{where}: the unit of the frequencies must be {_KNOWN}; found "
                f"{value.strip()[:40]!r}."
            )
    if len(keyed) > 1:
        raise SweepError(
            f"{where}: the unit of the frequencies must be said once; found "
            f"{' and '.join(keyed.values())}."
        )
    return next(iter(keyed.items()), None)


def columns_of_keys(columns: Mapping[str, np.ndarray]) -> set[str]:
    """The columns that repeat the unit of the frequencies, or that of time."""
    letters = {column: letters_of(column) for column in _repeated_texts(columns)}
    return {column for column, key in letters.items() if key == "timeunit" or _KEY.fullmatch(key)}


def _repeated_texts(columns: Mapping[str, np.ndarray]) -> dict[str, str]:
    """The text of each column that has the same one in every row."""
    texts = {
        name: {*map(str, column.tolist())}
        for name, column in columns.items()
        if column.dtype.kind in "OU"
    }
    return {name: held.pop() for name, held in texts.items() if len(held) == 1}


def units_spoken_of(notes: Iterable[str], names: Iterable[str]) -> dict[str, str]:
    """rad/s and kHz where any note has them, with what stands there; not in names of columns and
    what f0 is told in.
    """
    heads = sorted(names, key=len, reverse=True)
    spoken: dict[str, str] = {}
    for note in notes:
        shown = " ".join(note.strip("#%!/*; ").split())
        for name in heads:
            note = (
                note.replace(name, "")
                if any(one.search(name) for one in _SPEAKS.values())
                else note
            )
        note = F0_TOLD.sub("", note)
        for unit, pattern in _SPEAKS.items():
            if pattern.search(note):
                spoken.setdefault(unit, shown[:60])
    return spoken


def numbers_show_radians(
    frequency: np.ndarray, matrix: np.ndarray | None, f0_hz: Iterable[float]
) -> str:
    """Why numbers that would be Hz look like rad/s, in words; "" where they do not.

    Grids begin and end at round numbers. And high up an inductance seen in dq is L (s + omega_0 J),
    so that f |Z_qd - Z_dq| / |Z_dd + Z_qq| is f0, or omega_0 where f is in rad/s.

    matrix : (n, 2, 2) in dq, admittance or impedance in any unit; None: another frame.
    """
    ends = np.array([frequency.min(), frequency.max()])
    if (
        ends[0] > 0
        and ends[0] < ends[1]
        and is_round(ends / (2 * np.pi)).all()
        and not is_round(ends).any()
    ):
        low, high = ends / (2 * np.pi)
        return f"divided by 2 pi they run from {low:.3g} to {high:.3g}, round numbers"
    for nominal in f0_hz:
        if _turned_at(frequency, matrix, 2 * np.pi * nominal):
            return (
                f"high up d and q are turned as an inductance turns them at 2 pi times {nominal:g} "
                "Hz"
            )
    return ""


def numbers_show_hertz(
    frequency: np.ndarray, matrix: np.ndarray | None, f0_hz: Iterable[float]
) -> bool:
    """Whether an inductance turns d and q at f0 high up, by the same law: then the numbers are
    Hz.
    """
    return any(_turned_at(frequency, matrix, nominal) for nominal in f0_hz)


def _turned_at(frequency: np.ndarray, matrix: np.ndarray | None, wanted: float) -> bool:
    if matrix is None or not len(frequency):
        return False
    high = frequency >= frequency.max() * 10**-0.5
    turned = matrix[:, 1, 0] - matrix[:, 0, 1]
    along = matrix[:, 0, 0] + matrix[:, 1, 1]
    with np.errstate(all="ignore"):
        ratio = (frequency * np.abs(turned) / np.abs(along))[high] / wanted
    if len(ratio) < 3 or not np.isfinite(ratio).all():
        return False
    return bool(np.abs(ratio - 1).max() < _STEADY and abs(np.median(ratio) - 1) < _NEAR_F0)


def is_round(values: np.ndarray) -> np.ndarray:
    """Whether numbers have at most three significant digits, to the precision of a printed
    table.
    """
    digits = 10.0 ** (2 - np.floor(np.log10(values)))
    return np.abs(np.round(values * digits) / (values * digits) - 1) < 3e-6
