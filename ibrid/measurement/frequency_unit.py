"""In which unit the frequencies of a table are: as their name, what stands beside them or, against both, their numbers say."""

import re
from collections.abc import Iterable, Mapping

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.column_map import Source
from ibrid.measurement.column_words import letters_of, meaning_of, unit_of
from ibrid.measurement.foreign_table import ForeignTable
from ibrid.measurement.import_account import Account

#: Letters of the name of what holds the unit: FrequencyUnit, freq_unit, unit of frequency, Frequenzeinheit.
_FREQUENCY = r"(f|fr|freq|frequency|frequencies|frequenz|frequence|frecuencia|w|omega|ω|频率)"
_UNIT_OF = r"(units?|einheit|unite|unidad)(of|der|de|dela)?(the)?"
_KEY = re.compile(rf"{_FREQUENCY}s?(units?|einheit|单位)|{_UNIT_OF}{_FREQUENCY}(en|s)?")
_PAIR = re.compile(r"([^\W\d][^:=\n]*?)\s*[:=]\s*['\"]?([^\d'\",;\n][^'\",;\n]*)")
#: "all frequencies are in rad/s", "omega [rad/s]": words and a unit, with no number between or behind.
_PROSE = re.compile(
    rf"(?<![^\W_])(?P<of>[\w]+[\s-]+)?{_FREQUENCY}(?![^\W_])[^\d:=,;\n]{{0,30}}?"
    r"(?P<unit>[kM]?Hz|[kM]?rad\s?/\s?s(?:ec(?:ond)?)?|radians per second)(?![\w/])(?!\W*\d)",
    re.IGNORECASE,
)
#: Frequencies of something else than the scan.
_OTHER = re.compile(r"sampl|nominal|grid|base|rated|fundamental|switch|cut|corner|resonan|system|natural|clock", re.I)
_TIMES = {"second": 1.0, "minute": 60.0, "hour": 3600.0, "millisecond": 1e-3, "microsecond": 1e-6}
#: How near the middle of what turns d and q is to omega_0, and how near each of its numbers, where f is in rad/s.
_NEAR_F0, _STEADY = 0.05, 0.2

#: What a unit measures, "frequency" or "angular frequency", and its size in Hz or rad/s.
Measure = tuple[str, float]


def in_hertz(table: ForeignTable, source: Source, account: Account, *, angular: bool) -> tuple[np.ndarray, bool]:
    """The frequencies of a column in Hz, and whether nothing says that they are.

    In this order: the unit that the map says; that of the column's name, and of a key beside the table, which must agree; a
    sentence beside it; and `angular`, whether the name is that of an angular frequency (w, omega).

    Raises SweepError where keys contradict each other; asks where name and key do.
    """
    name = source.columns[0]
    meaning = meaning_of(name)
    mapped = (measure_of(source.unit), source.unit) if source.unit else None
    named = ((meaning.dimension, meaning.factor), "") if meaning.dimension else None
    keyed = measure_keyed(table.notes, table.columns)
    if not mapped and named and keyed and named[0] != keyed[0]:
        _ask_unit(f"its name says {meaning.unit}, and beside it stands {keyed[1]}", source, account)
    said = mapped or named or keyed or (None if angular else measure_in_prose(table.notes, table.columns))
    measure, words = said or (("angular frequency" if angular else "frequency", 1.0), "")
    if measure is None:
        raise SweepError(f"{table.where}: {name} must be in Hz or rad/s, also with k; found {source.unit}.")
    radians = measure[0] == "angular frequency"
    unsaid = not said and not angular
    shown = "Hz, as nothing says otherwise" if unsaid else "rad/s" if radians else "Hz"
    account.read("frequency", name, f"{shown} ({words} stands beside it)" if words and not mapped else shown)
    return table.columns[name] * measure[1] / (2 * np.pi if radians else 1.0), unsaid


def doubt_hertz(
    table: ForeignTable,
    source: Source,
    frequency: np.ndarray,
    matrix: np.ndarray | None,
    f0_hz: float | None,
    account: Account,
) -> None:
    """Ask for the unit of frequencies that are Hz for want of a word, where something looks like rad/s.

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


def _ask_unit(why: str, source: Source, account: Account) -> None:
    column = f"--map freq={source.columns[0]}"
    account.ask(f"the unit of the frequencies ({why})", f"{column}[rad/s]", f"{column}[Hz]")


def measure_of(text: str) -> Measure | None:
    """Of a unit of frequency as programs and colleagues write it: kHz, rad/s, rad/TimeUnit, cycles/s, rpm; None for no such."""
    word = re.sub(r"\s*(/|per)\s*", "/", text.strip().strip("[]()").lower())
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


def measure_keyed(notes: Iterable[str], columns: Mapping[str, np.ndarray]) -> tuple[Measure, str] | None:
    """What a key beside a table, or a column that repeats it, says: FrequencyUnit, also MATLAB's rad/TimeUnit; and its words.

    Raises SweepError where two contradict each other.
    """
    pairs = [(letters_of(key), value) for note in notes for key, value in _PAIR.findall(note)]
    for name, column in columns.items():
        if column.dtype.kind in "OU" and len({*map(str, column.tolist())}) == 1:
            pairs.append((letters_of(name), str(column[0])))
    time_unit = next((value.strip() for key, value in pairs if key == "timeunit"), "second")
    keyed: dict[Measure, str] = {}
    for key, value in pairs:
        measure = measure_of(re.sub("timeunit", time_unit, value, flags=re.I)) if _KEY.fullmatch(key) else None
        if measure:
            keyed[measure] = value.strip()
    if len(keyed) > 1:
        raise SweepError(f"the unit of the frequencies must be said once; found {' and '.join(keyed.values())}.")
    return next(iter(keyed.items()), None)


def measure_in_prose(notes: Iterable[str], names: Iterable[str]) -> tuple[Measure, str] | None:
    """What a sentence beside a table says of the unit of its frequencies; lines with names of its columns say nothing."""
    heads = [name for name in names if len(name) > 1]
    for note in notes:
        if sum(name in note for name in heads) > 1:
            continue
        for prose in _PROSE.finditer(note):
            measure = measure_of(prose["unit"])
            if measure and not _OTHER.search(prose["of"] or ""):
                return measure, prose["unit"]
    return None


def numbers_show_radians(frequency: np.ndarray, matrix: np.ndarray | None, f0_hz: Iterable[float]) -> str:
    """Why numbers that would be Hz look like rad/s, in words; "" where they do not.

    Grids begin and end at round numbers. And high up an inductance seen in dq is L (s + omega_0 J), so that
    f |Z_qd - Z_dq| / |Z_dd + Z_qq| is f0, or omega_0 where f is in rad/s.

    matrix : (n, 2, 2) in dq, admittance or impedance in any unit; None: another frame.
    """
    ends = np.array([frequency.min(), frequency.max()])
    if ends[0] > 0 and ends[0] < ends[1] and is_round(ends / (2 * np.pi)).all() and not is_round(ends).any():
        low, high = ends / (2 * np.pi)
        return f"divided by 2 pi they run from {low:.3g} to {high:.3g}, round numbers"
    if matrix is None:
        return ""
    high = frequency >= ends[1] * 10**-0.5
    turned = matrix[:, 1, 0] - matrix[:, 0, 1]
    along = matrix[:, 0, 0] + matrix[:, 1, 1]
    with np.errstate(all="ignore"):
        ratio = (frequency * np.abs(turned) / np.abs(along))[high]
    middle = float(np.median(ratio)) if len(ratio) >= 3 and np.isfinite(ratio).all() else 0.0
    for nominal in f0_hz:
        steady = np.abs(ratio / (2 * np.pi * nominal) - 1).max() < _STEADY if middle else False
        if steady and abs(middle / (2 * np.pi * nominal) - 1) < _NEAR_F0:
            return f"high up d and q are turned as an inductance turns them at {middle:.3g}, 2 pi times {nominal:g} Hz"
    return ""


def is_round(values: np.ndarray) -> np.ndarray:
    """Whether numbers have at most three significant digits, to the precision of a printed table."""
    digits = 10.0 ** (2 - np.floor(np.log10(values)))
    return np.abs(np.round(values * digits) / (values * digits) - 1) < 3e-6
