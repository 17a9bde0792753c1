"""One foreign table understood: which columns are the frequency, the matrix and the steady state,
and in which unit.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ibrid.errors import SweepError, some
from ibrid.measurement.conventions.conversions import Quantity
from ibrid.measurement.conventions.positive_sequence import WORDS
from ibrid.measurement.formats.csv_columns import ENTRIES
from ibrid.measurement.importing.column_map import FREQUENCIES, Source, parse_map
from ibrid.measurement.importing.column_numbers import (
    complex_numbers,
    in_unit_of_matrix,
    real_numbers,
    require_real,
    unit_written,
    unsaid_decibels,
    words_of,
)
from ibrid.measurement.importing.column_words import (
    Meaning,
    letters_of,
    meaning_of,
    unit_of,
    unit_of_matrix,
    without_unit,
)
from ibrid.measurement.importing.doubts.fill_values import mind_fill_values
from ibrid.measurement.importing.doubts.other_base import mind_other_base
from ibrid.measurement.importing.doubts.perhaps_recording import recording_refused
from ibrid.measurement.importing.doubts.polar_units import (
    Seen,
    ask_decibels,
    ask_radians,
    decibels_seen,
    mind_decibels_of_power,
)
from ibrid.measurement.importing.doubts.units_at_rest import (
    LARGEST_PU,
    ask_units_of_powers,
    ask_which_voltage,
)
from ibrid.measurement.importing.doubts.which_matrix import ask_which_matrix, mind_words
from ibrid.measurement.importing.dq_frequency import Counting
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.frequency_unit import columns_of_keys, doubt_hertz, in_hertz
from ibrid.measurement.importing.import_account import (
    Account,
    bases_of,
    mind_beside,
    mind_power,
    number_said,
)
from ibrid.measurement.importing.numbers.percent import as_shown
from ibrid.measurement.importing.point_columns import (
    columns_of_points,
    names_in,
    require_named,
    require_names,
    tidy_name,
)
from ibrid.measurement.importing.told import (
    base_of,
    current_in_words,
    doubts_beside,
    numbers_beside,
    rating_beside,
    told_beside,
)
from ibrid.ranges import require_in_range

#: What to do with columns for several operating points.
_A_GROUP_EACH = (
    "if groups of columns are operating points, import one by one, --map Ydd=#2+j#3,.. --op NAME "
    "--p P --q Q --out ONE.csv, then "
    "join them: ibrid import ONE.csv TWO.csv --out ALL.csv"
)
#: Where the steady state stands of several tables, and in columns.
OF_EACH = "p and q of each to its name (P0.8_Q0), its comments or its .meta (p: 0.8)"
COLUMNS = "--map p=COLUMN[kW],q=COLUMN[kvar]"
#: Voltages of the base that need no word, per unit.
_USUAL_V = 0.9, 1.1
#: How near frequencies in Hz and in rad/s beside each other must be, as a part: as near as tables
#: are printed.
_SAME_FREQUENCY = 1e-3
#: A reference or an initial value of p, q or v, by its name in small letters.
_REFERENCE = re.compile("[pqvu](ref|0)")
#: What a part has for each of its rows, beside its table and powers.
_ROWS = ("names", "frequency", "matrix", "sigma", "repeat", "amplitude")


@dataclass(frozen=True, eq=False)
class Part:
    """The rows of one table, in its own convention.

    told : what its name and comments say. names : of operating points, "" where only p, q, v tell
    them apart. power : p, q, v as (values, dimension), NaN where nothing says them. unused :
    columns. one_point : rows of one name are one operating point,
    since the user says so. named : the names are those of a column. told_once : p, q and v are no
    columns.
    """

    table: ForeignTable
    told: Mapping[str, Any]
    names: np.ndarray
    power: Mapping[str, tuple[np.ndarray, str]]
    frequency: np.ndarray
    matrix: np.ndarray
    quantity: Quantity
    unit: str
    factor: float
    sigma: np.ndarray
    repeat: np.ndarray
    amplitude: np.ndarray
    counting: Counting
    unused: tuple[str, ...] = ()
    one_point: bool = False
    named: bool = False
    told_once: bool = False

    def at(self, rows: np.ndarray) -> "Part":
        """Some of the rows."""
        columns = {name: column[rows] for name, column in self.table.columns.items()}
        return replace(
            self,
            table=replace(self.table, line=self.table.line[rows], columns=columns),
            power={
                role: (values[rows], dimension) for role, (values, dimension) in self.power.items()
            },
            **{name: getattr(self, name)[rows] for name in _ROWS},
        )


def part_of(table: ForeignTable, account: Account, *, several: bool) -> Part:
    stem = f"{table.stem} {table.book}"
    beside = told_beside(stem, table.notes)
    told: dict[str, Any] = rating_beside(table.notes) | beside | account.said
    mind_beside(table.where, beside, account)
    way = current_in_words(table.notes)
    if way and told["current"] == way[0] and "current" not in account.said:
        account.remark(f"current: {way[0]}, as its words say: {way[1][:80]!r}")
    for doubt in doubts_beside(stem, table.notes):
        account.remark(f"{table.where}: {doubt}")
    mapped = parse_map(account.maps, table.columns, numbers_beside(stem, table.notes))
    table = _with_percent(table, mapped, account)
    sources = _guessed(table, mapped) | mapped
    length = len(table.line)
    frequency, grid, unsaid = _frequency(table, sources, account)
    if not mapped.keys() & {"freq", "omega"}:
        _require_one_frequency(table, frequency, sources)
    if "op" not in mapped:
        sources.pop("op", None)
        said = [point.name for point in account.points if point.name]
        by = columns_of_points(table, frequency, said)
        sources |= {"op": Source(by, " and ")} if by else {}
    quantity, frame, entries = _family(table, sources, told, account)
    if frame == "dq" and grid == "network" and not mapped.keys() & {"freq", "omega"}:
        _refuse_network_frequency(table, sources)
    used = {column for source in sources.values() for column in source.columns}
    if not any(sources[role].unit for role in FREQUENCIES if role in mapped):
        used |= columns_of_keys(table.columns)
    unused = [name for name in table.columns if name not in used]
    _require_both_parts(table, [sources[name] for name in entries], unused)
    entry_columns = [column for name in entries for column in sources[name].columns]
    mind_fill_values(table, entry_columns, account)
    said_unit = str(told.get("unit") or "")
    decibel = unsaid_decibels(table, [sources[name] for name in entries], said_unit, account)
    values = [
        complex_numbers(table, sources[name], account, unsaid_decibel=decibel) for name in entries
    ]
    of_entries = [sources[name] for name in entries]
    matrix = np.stack([value for value, _ in values], axis=-1)
    ask_radians(table, of_entries, quantity.letter, account)
    seen = "no" if decibel else decibels_seen(of_entries, frequency, matrix, quantity.letter, frame)
    unit, factor = _unit(table, of_entries, quantity, told, account, seen)
    if frame == "dq":
        mind_decibels_of_power(of_entries, frequency, matrix, quantity.letter, account)
    matrix = matrix * factor
    if not told.get("quantity"):
        ask_which_matrix(table, sources, frame, matrix, account)
    if unsaid:
        f0 = number_said(told.get("f0_hz"))
        doubt_hertz(
            table,
            unsaid,
            frequency,
            matrix.reshape(-1, 2, 2) if frame == "dq" else None,
            f0,
            account,
        )
    counted = account.said.get("sequence_frequency")
    if counted and (frame == "dq" or (frame, counted) == ("positive", "dq")):
        raise SweepError(
            f"{table.where}: --sequence-frequency {counted} says nothing of this matrix; leave it "
            "out."
        )
    mind_words(entries, sources, account)
    for name, (_, parts) in zip(entries, values, strict=True):
        shown = parts or unit_written(sources[name]) or told.get("unit") or "unit unknown"
        account.read(name, words_of(sources[name]), shown)
    if frame == "positive":
        account.remark(WORDS)
        matrix = np.repeat(matrix, 4, axis=1)
    elif frame == "pn" and grid not in ("dq", "network"):
        option = "--sequence-frequency"
        account.ask(
            "at which frequency the sequences are counted", f"{option} dq", f"{option} network"
        )
    network = frame == "positive" or (frame == "pn" and grid == "network")
    power = {role: _measured(table, sources.get(role), role, told, account) for role in "pqv"}
    ask_units_of_powers(power, sources, account)
    by_row = [
        role
        for role in "pqv"
        if role in sources and sources[role].columns and account.said.get(role) is None
    ]
    sigma = [
        name
        for name in ("sigma", *(f"sigma_{entry}" for entry in ENTRIES.get(frame, ())))
        if name in sources
    ]
    sigma = [name for name in sigma if name != "sigma" or len(sigma) == 1]
    names = np.full(length, "", dtype=object)
    if "op" in sources:
        source = sources["op"]
        if source.columns:
            names = names_in(table, source.columns)
            require_names(
                table, source.columns, np.isfinite(matrix).all(axis=1) & np.isfinite(frequency)
            )
            require_named(account.said.get("op"), names, words_of(source))
        else:
            names[:] = tidy_name(source.unit or f"{source.constant:g}")
        account.read("operating point", words_of(source), "")
    elif op := told.get("op") or table.op or several * table.stem:
        names[:] = tidy_name(str(op))

    def optional(role: str) -> np.ndarray:
        if role not in sources:
            return np.full(length, np.nan)
        account.read(role, words_of(sources[role]), sources[role].unit)
        values = real_numbers(table, sources[role])[0]
        if role != "repeat" and (values < 0).any():
            row, name = int((values < 0).argmax()), "".join(sources[role].columns)
            raise SweepError(
                f"{table.place(row, name)} must not be negative; found {values[row]:g}, correct it."
            )
        return values

    matrix_unit = next(
        filter(None, (unit_written(sources[name]) for name in entries)),
        str(told.get("unit") or "").partition(":")[0],
    )
    deviations = [
        in_unit_of_matrix(optional(name), table, sources[name], matrix_unit) for name in sigma
    ]
    part = Part(
        table,
        told,
        names,
        power,
        frequency,
        matrix.reshape(-1, 2, 2),
        quantity,
        unit,
        factor,
        np.stack(deviations, axis=-1) * factor if deviations else np.empty((length, 0)),
        optional("repeat"),
        optional("amplitude"),
        Counting(frame, network),
        tuple(unused),
        bool(account.said.get("op") or mapped.keys() & {"op", "repeat"}),
        "op" in sources and bool(sources["op"].columns),
        not by_row,
    )
    _mind_powers(part, sources, beside, account)
    if unused:
        account.remark(f"not used: {some(unused, 8)}")
    if "v" not in sources and told.get("v") is None:
        volts = [name for name in unused if meaning_of(name).dimension == "voltage"]
        account.remark(f"v taken as 1{f', not from {some(volts)}' if volts else ''} (else --v)")
    return _without_gaps(part, account)


def _with_percent(
    table: ForeignTable, mapped: Mapping[str, Source], account: Account
) -> ForeignTable:
    """The table with columns that the map says to be in % as a workbook shows them."""
    names = [name for one in mapped.values() if one.unit == "%" for name in one.columns]
    shown = as_shown(table, names)
    for remark in shown.remarks[len(table.remarks) :]:
        account.remark(remark)
    return shown


def _guessed(table: ForeignTable, mapped: Mapping[str, Source]) -> dict[str, Source]:
    """What the names of the columns say beside the map; of several readings of an entry, real and
    imaginary part come first.
    """
    sources: dict[str, Source] = {}
    parts: dict[str, dict[tuple[str, str], list[str]]] = {}
    settled = {role[1:] for role in mapped if len(role) == 3}
    of_entries = bool(settled)
    settled |= {*FREQUENCIES} if mapped.keys() & {*FREQUENCIES} else set()
    for name in table.columns:
        meaning = Meaning() if name in table.numbered else meaning_of(name)
        if meaning.role == "positive" and of_entries:
            continue
        if meaning.role in ("matrix", "positive") and meaning.entry not in settled:
            readings = parts.setdefault(meaning.letter + meaning.entry, {})
            readings.setdefault((meaning.part, meaning.dimension), []).append(name)
        elif meaning.role == "sigma":
            sources.setdefault(
                f"sigma_{meaning.entry}" if meaning.entry else "sigma", Source((name,))
            )
        elif meaning.role not in (
            "",
            "matrix",
            "positive",
            "entry",
            "re",
            "im",
            "mag",
            "phase",
            *settled,
        ):
            before = sources.setdefault(meaning.role, Source((name,)))
            if _is_reference(before.columns[0]) and not _is_reference(name):
                sources[meaning.role] = Source((name,))
    if twice := [
        names for readings in parts.values() for names in readings.values() if len(names) > 1
    ]:
        raise SweepError(
            f"{table.where}: {twice[0][0]} and {twice[0][1]} mean the same number; {_A_GROUP_EACH}."
        )
    for entry, readings in parts.items():
        named = {part: names[0] for (part, _), names in reversed(readings.items())}
        size = named.get("mag") or named.get("")
        if {"re", "im"} <= set(named):
            sources[entry] = Source((named["re"], named["im"]), "j")
        elif "phase" in named and size:
            sources[entry] = Source((size, named["phase"]), "@")
        elif "" in named:
            sources[entry] = Source((named[""],))
        elif "re" in named and table.columns[named["re"]].dtype.kind == "c":
            sources[entry] = Source((named["re"],))
    return sources


def _is_reference(name: str) -> bool:
    """Whether a column of p, q or v is what was asked for or where it began, which is taken only
    where nothing is measured.
    """
    return _REFERENCE.fullmatch(letters_of(without_unit(name)[0])) is not None


def _require_both_parts(
    table: ForeignTable, sources: Sequence[Source], unused: Sequence[str]
) -> None:
    """Raise SweepError where an entry is a column of real numbers, and its other part may be one
    that nobody reads.
    """
    single = [one.columns[0] for one in sources if one.columns and not one.joined]
    numbers = {name: column for name, column in table.columns.items() if column.dtype.kind == "f"}
    real = [name for name in single if name in numbers and np.nan_to_num(numbers[name]).any()]
    left = [name for name in unused if name in numbers]
    if real and (left or len(real) == len(sources)):
        raise SweepError(
            f"{table.where}: {real[0]} must be complex; found real "
            f"numbers{' beside ' * bool(left)}{some(left)}, name both parts "
            "of each entry, such as --map Ydd=RE+jIM,Ydq=MAG@PHASE[deg],.. (#3: the third column)."
        )


def _frequency(
    table: ForeignTable, sources: Mapping[str, Source], account: Account
) -> tuple[np.ndarray, str, Source | None]:
    """Hz; in which frame that is the frequency, as said or as the column's name says: "dq",
    "network" or ""; and its source where Hz were taken because nothing says otherwise.
    """
    role = next((role for role in FREQUENCIES if role in sources), None)
    if role is None:
        columns = some(table.columns, 12) if table.columns else "none among its arrays"
        if refused := recording_refused(table, has_frequency=False):
            raise SweepError(refused)
        raise SweepError(
            f"{table.where} must have a column of frequencies; found {columns}, name it: --map "
            "freq=COLUMN."
        )
    if not sources[role].columns:
        raise SweepError(
            f"{table.where}: the frequency must be a column; found one number, name a column: "
            "--map freq=COLUMN."
        )
    real_numbers(table, sources[role])
    hertz, unsaid = in_hertz(table, sources[role], account, angular=role == "omega")
    named = next(
        (word for word in ("dq", "network") if word in words_of(sources[role]).lower()), ""
    )
    return hertz, account.said.get("sequence_frequency") or named, sources[role] if unsaid else None


def _require_one_frequency(
    table: ForeignTable, hertz: np.ndarray, sources: Mapping[str, Source]
) -> None:
    """Raise SweepError where another column that could be the frequency holds others: that of the
    network beside that of the dq frame, or angular ones.

    hertz : (n,) of the first of `freq` and `omega` in the sources.
    """
    taken = "freq" if "freq" in sources else "omega"
    first = sources[taken].columns[0]
    for name in table.columns:
        meaning = Meaning() if name in table.numbered else meaning_of(name)
        if name == first or meaning.role not in FREQUENCIES:
            continue
        require_real(table, name)
        if meaning.role == "freq" and np.ptp(table.columns[name]) == 0 < np.ptp(hertz):
            continue  # that of the grid
        turns = 2 * np.pi if meaning.role == "omega" else 1.0
        beside = table.columns[name] * meaning.factor / turns
        apart = ~np.isclose(beside, hertz, rtol=_SAME_FREQUENCY, equal_nan=True)
        if np.isfinite(beside).any() and apart.any():
            row = int(apart.argmax())
            must = "2 pi times" if turns != 1.0 else "the same as"
            raise SweepError(
                f"{table.place(row, name)} must be {must} {first}; found {beside[row]:g} Hz "
                f"beside {hertz[row]:g} Hz, say which column is meant: --map {taken}={first} or "
                f"--map {meaning.role}={name}."
            )


def _refuse_network_frequency(table: ForeignTable, sources: Mapping[str, Source]) -> None:
    """Raise SweepError where dq entries stand at frequencies that their name calls those of the
    network, f + f0.
    """
    role = "freq" if "freq" in sources else "omega"
    name = words_of(sources[role])
    raise SweepError(
        f"{table.where}: entries in dq must have the frequency in dq; found {name}, by its name "
        f"that of the network (f + f0), subtract f0 or add --map {role}={name} if it is that in dq."
    )


def _family(
    table: ForeignTable, sources: Mapping[str, Source], told: Mapping[str, Any], account: Account
) -> tuple[Quantity, str, tuple[str, ...]]:
    """Admittance or impedance, in which frame, and the names of the four sources, or of one."""
    letters = (
        ("Z", "Y", "") if str(told.get("quantity") or "")[:1].upper() == "Z" else ("Y", "Z", "")
    )
    for frame, entries in {**ENTRIES, "positive": ("pp",)}.items():
        for letter in letters:
            names = tuple(letter + entry for entry in entries)
            coupled = frame == "positive" and {f"{letter}pn", f"{letter}np"} & sources.keys()
            if all(name in sources for name in names) and not coupled:
                return (
                    Quantity(
                        _quantity(letter, table, sources[names[0]], told, account), frame != "dq"
                    ),
                    frame,
                    names,
                )
    missing = [
        name
        for name in ("Ydd", "Ydq", "Yqd", "Yqq")
        if name not in sources and f"Z{name[1:]}" not in sources
    ]
    words = (
        "name the columns, for instance --map Ydd=A+jB,Ydq=C+jD,.. (or Ydd=MAG@PHASE, Zdd=.., "
        "Ypp=.., #3 for the third column; "
        "Zpp alone for a scan of the positive sequence)"
    )
    if table.numbered:
        words = (
            "an array that is a matrix must have the shape (K, 2, 2) or (2, 2, K), a cell array be "
            "2 x 2 of K numbers each; "
            "name the columns of another, for instance --map Ydd=Y:1,Ydq=Y:2,.. (Zdd=.., #3 for "
            "the third column)"
        )
    if sum(missing[0][1:] in name for name in table.columns) > 2:
        words = _A_GROUP_EACH
    if doubted := {name: doubt for name in table.columns if (doubt := meaning_of(name).doubt)}:
        name, doubt = next(iter(doubted.items()))
        raise SweepError(
            f"{table.where}: {name} may be a conjugate, a negative, a transpose or of another "
            f"device, as its {doubt!r} could say; where the numbers are those of the inverter as "
            "they stand, name the columns: --map Ydd=A+jB,Ydq=C+jD,.. (#3: the third column)."
        )
    if len(missing) == 4 and (refused := recording_refused(table, has_frequency=True)):
        raise SweepError(refused)
    found = some(table.columns, 9)
    raise SweepError(
        f"{table.where} must have the four entries of a 2x2 matrix; {missing[0]} was not found "
        f"among {found}; {words}."
    )


def _quantity(
    letter: str, table: ForeignTable, source: Source, told: Mapping[str, Any], account: Account
) -> str:
    said = str(told.get("quantity") or "")[:1].upper()
    if letter and said not in ("", letter):
        raise SweepError(
            f"{table.where}: --quantity {said} is not what {words_of(source)} says; leave it out."
        )
    if letter:
        return letter
    dimension = (unit_of(unit_written(source)) or ("",))[0]
    words = " ".join((table.stem, *table.notes)).lower()
    for candidate, word, measured in (
        ("Y", "admittan", "admittance"),
        ("Z", "impedan", "impedance"),
    ):
        if (
            said == candidate
            or dimension == measured
            or told.get("unit") == {"Y": "S", "Z": "ohm"}[candidate]
        ):
            return candidate
        if not said and word in words:
            account.remark(f"taken as {measured}, as its words say")
            return candidate
    account.ask(
        "whether its matrices are admittances or impedances", "--quantity Y", "--quantity Z"
    )
    return "Y"


def _unit(
    table: ForeignTable,
    sources: Sequence[Source],
    quantity: Quantity,
    told: Mapping[str, Any],
    account: Account,
    decibels: Seen,
) -> tuple[str, float]:
    """pu, S or ohm, and the factor that leads there. decibels : whether the numbers show them."""
    plain = {"Y": "S", "Z": "ohm"}[quantity.letter]
    said = str(told.get("unit") or "")
    written = {unit_written(source) for source in sources if source.columns}
    known = {
        one[:2]
        for one in map(unit_of_matrix, written)
        if one and one[0] in ("admittance", "impedance", "per unit")
    }
    if len(known) > 1:
        raise SweepError(
            f"{table.where}: all entries must be in one unit; found {', '.join(sorted(written))}."
        )
    dimension, factor = known.pop() if known else ("", 1.0)
    stands = ", ".join(sorted(filter(None, written)))
    if said.startswith("pu:"):
        if dimension not in ("", "per unit"):
            account.remark(f"unit: {said} as said, while the columns of {table.where} say {stands}")
            factor = 1.0
        ours, theirs = bases_of(told, account), base_of(said[3:], "--unit pu:BASE")
        if ours is None:
            return "pu", factor
        ratio = (ours[1] ** 2 / ours[0]) / (theirs[1] ** 2 / theirs[0])
        return "pu", factor * (ratio if quantity.letter == "Y" else 1 / ratio)
    if said:
        stated = unit_of_matrix(said)
        if stated is None or stated[0] not in ("admittance", "impedance", "per unit"):
            raise SweepError(
                "--unit must be pu, pu:BASE, S or ohm, also with m, k or M, or dBS or dBohm; found "
                f"{said[:40]!r}."
            )
        if dimension == stated[0] and factor != stated[1]:
            account.remark(
                f"unit: {stands} as the columns of {table.where} say, which are nearer to the "
                f"numbers than {said}"
            )
        elif dimension and dimension != stated[0]:
            account.remark(f"unit: {said} as said, while the columns of {table.where} say {stands}")
        factor = factor if dimension == stated[0] else stated[1]
        dimension = stated[0]
    if not dimension:
        is_known = told.get("base") or told.get("v_base_v")
        base = "" if is_known else " --base S_VA,V_LL (such as 10kVA,400V)"
        in_decibels = [f"--unit dB{plain}{base}"] if decibels != "no" else []
        account.ask(
            "the unit of its matrices",
            "--unit pu",
            f"--unit {plain}{base}",
            *in_decibels,
        )
        return "pu", 1.0
    if decibels == "likely":
        ask_decibels(sources, quantity.letter, account)
    mind_other_base(table.where, told, account, per_unit=dimension == "per unit" and not said[3:])
    if dimension != "per unit":
        bases_of(told, account)
    return {"per unit": "pu", "admittance": "S", "impedance": "ohm"}[dimension], factor


def _measured(
    table: ForeignTable, source: Source | None, role: str, told: Mapping[str, Any], account: Account
) -> tuple[np.ndarray, str]:
    """p, q or v of every row, with the dimension of its unit; told ones where there is no column,
    NaN where there are none.
    """
    length = len(table.line)
    if source is not None and account.said.get(role) is None:
        values, dimension, _ = real_numbers(table, source)
        name, shown, unit = (
            source.name or "".join(source.columns),
            words_of(source),
            unit_written(source),
        )
    elif told.get(role) is None:
        if role == "v":
            return np.ones(length), "per unit"
        return np.full(length, np.nan), "per unit"
    else:
        value = told[role]
        dimension, name, unit = value[1:] if isinstance(value, tuple) else ("", "", "")
        values, shown = (
            np.full(length, number_said(value)),
            f"{name}, beside the table" if name else f"--{role}",
        )
    account.read(role, shown, unit)
    largest, place = (
        float(np.nanmax(np.abs(values), initial=0.0)),
        f"--map {role}={name or 'COLUMN'}",
    )
    require_in_range(role, largest or 1.0, f"{table.where}: {role}")
    if role == "v" and in_volts(values, dimension) and "_" not in unit and source is not None:
        ask_which_voltage(values, f"v={name}", told, account)
    if role != "v" and not dimension and largest > LARGEST_PU:
        account.ask(f"the unit of {role} (up to {largest:g})", f"{place}[kW]", f"{place}[W]")
    return values, dimension


def _mind_powers(
    part: Part, sources: Mapping[str, Source], beside: Mapping[str, Any], account: Account
) -> None:
    """Remark on p, q and v that the user says and that stand otherwise in columns or beside the
    table.
    """
    table = part.table
    for role in "pqv":
        source = sources.get(role)
        if account.said.get(role) is None or (source is None and beside.get(role) is None):
            continue
        if source is None:
            value, dimension, name, unit = beside[role]
            values = np.full(len(table.line), value)
            factor = (unit_of(unit) or ("", 1.0))[1]
        elif any(
            table.columns[name].dtype.kind != "f" or np.isinf(table.columns[name]).any()
            for name in source.columns
        ):
            continue
        else:
            values, dimension, factor = real_numbers(table, source)
            name, unit = source.name or words_of(source), source.unit
        aside = Account((), dict(account.said))  # nothing is asked for the sake of a remark
        said = per_unit(role, part, aside)
        stands = per_unit(
            role, replace(part, power={**part.power, role: (values, dimension)}), aside
        )
        if aside.questions:
            stands = np.full(len(values), np.nan)
        mind_power(role, table.where, name, said, stands, values / factor, unit, account)


def per_unit(role: str, part: Part, account: Account) -> np.ndarray:
    values, dimension = part.power[role]
    said = str(part.told.get("unit") or "")
    if role == "v":
        if in_volts(values, dimension):
            bases = bases_of(part.told, account)
            values = values / (bases[1] if bases else 1.0)
            if bases and not _USUAL_V[0] < np.nanmedian(values) < _USUAL_V[1]:
                account.remark(
                    f"v is {np.nanmedian(values):.3g} of the base; is it line to line, rms?"
                )
        return values
    bases = bases_of(part.told, account) if dimension == "power" or said.startswith("pu:") else None
    if bases and dimension == "power":
        return values / bases[0]
    if not bases:
        return values
    ratio = base_of(said[3:], "--unit pu:BASE")[0] / bases[0]
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if largest <= LARGEST_PU < largest * ratio:
        raise SweepError(
            f"{part.table.where}: {role} must be per unit of the base of --unit, {said[3:]}; found "
            f"{largest:g}, which is {largest * ratio:.4g} on the base of the device, write "
            f"{role} {largest / ratio:.4g} where {largest:g} of the device is meant."
        )
    return values * ratio


def in_volts(values: np.ndarray, dimension: str) -> bool:
    """Whether voltages are not per unit: by their unit, or their size where they have none."""
    return dimension == "voltage" or (
        not dimension and np.nanmax(np.abs(values), initial=0.0) > LARGEST_PU
    )


def _without_gaps(part: Part, account: Account) -> Part:
    """Rows with empty cells are left out and said."""
    table = part.table
    used = {
        name: column
        for name, column in table.columns.items()
        if name not in part.unused and column.dtype.kind in "fc"
    }
    whole = np.isfinite(part.matrix).all(axis=(1, 2)) & np.isfinite(part.frequency)
    if not (whole & (part.frequency != 0)).any():
        raise SweepError(
            f"{table.where} must hold numbers at frequencies other than zero; found none."
        )
    if not whole.all():
        row = int(whole.argmin())
        name = next((name for name, column in used.items() if np.isnan(column[row])), "")
        may_be = (
            ", which may be an error such as #DIV/0! or a formula that was never computed"
            if table.cells
            else ""
        )
        account.remark(
            f"left out: {(~whole).sum()} rows with empty cells, first "
            f"{table.place(row, name)}{may_be}"
        )
    return part.at(whole)
