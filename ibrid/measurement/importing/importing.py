"""One door for anybody's table: columns are guessed and shown, what the numbers do not say is asked
for, all at once.

Tables that keep the four entries of a matrix apart, in rows or in files of their own, become one
with them side by side.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import SweepError, near, some, where_it_is_said
from ibrid.measurement.conventions.header import CHOICES, HEADER_KEYS, POSITIVE, header_of
from ibrid.measurement.conventions.positive_sequence import NOTE, WORDS
from ibrid.measurement.formats.bundle import stem_of, suffix_of
from ibrid.measurement.formats.csv_file import sweep_of_table
from ibrid.measurement.formats.csv_table import Table
from ibrid.measurement.formats.grouping import first_near, rows_of_each
from ibrid.measurement.formats.model_poles import MODEL
from ibrid.measurement.formats.pscad import pscad_response
from ibrid.measurement.formats.response import sidecar_keys
from ibrid.measurement.formats.touchstone import SCATTERING, TOUCHSTONE, touchstone_response
from ibrid.measurement.importing.column_map import without_map_of_entry
from ibrid.measurement.importing.doubts.alike_points import mind_alike_points
from ibrid.measurement.importing.dq_frequency import in_dq
from ibrid.measurement.importing.foreign_part import OF_EACH, Part, part_of, per_unit
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.import_account import (
    Account,
    ImportQuestion,
    SaidPoint,
    bases_of,
    number_said,
)
from ibrid.measurement.importing.import_directions import (
    DIRECTIONS,
    ask_of_directions,
    directions_of,
    frame_of,
    names_q_first,
)
from ibrid.measurement.importing.import_frequency import ask_of_nominal, doubt_nominal
from ibrid.measurement.importing.numbers import polar_cells
from ibrid.measurement.importing.numbers.number_format import number_format, without_format
from ibrid.measurement.importing.point_rows import operating_points
from ibrid.measurement.importing.repeated_runs import require_repeats
from ibrid.measurement.importing.shapes.copied_rows import without_copied_rows
from ibrid.measurement.importing.shapes.entries_apart import (
    are_entries_apart,
    entries_last,
    joined_entries,
    named_as_entry,
    widened,
    without_others,
)
from ibrid.measurement.importing.shapes.long_tables import with_entries
from ibrid.measurement.importing.shapes.more_ports import own_block
from ibrid.measurement.importing.shapes.rest_columns import with_rest
from ibrid.measurement.importing.shapes.signed_names import without_signs
from ibrid.measurement.importing.table_files import read_tables
from ibrid.measurement.importing.told import point_said
from ibrid.measurement.importing.unsaid import UnsaidError
from ibrid.measurement.sweeps.sweep import Sweep

#: What can be said about a foreign table, beside the map.
SAYABLE = (*HEADER_KEYS, "base", "quantity", "sequence_frequency", "op", "p", "q", "v")
#: How a note begins that says what was assumed.
MIND = "mind: "
#: Operating points nearer than that are one.
_SAME = 0.02
#: Operating points of one frequency each from which on they are no sweep.
_SINGLE = 4


@dataclass(frozen=True, eq=False)
class Imported:
    """`readings` : (what, from which columns, in which unit).

    `remarks` : what was assumed or left out. `questions` : what must be said first; then `sweep` is
    None.
    """

    readings: tuple[tuple[str, str, str], ...]
    remarks: tuple[str, ...]
    questions: tuple[ImportQuestion, ...]
    sweep: Sweep | None
    where: str = ""

    @property
    def asked(self) -> str:
        """All that must be said first, with the options to add, in a sentence."""
        asked = "; ".join(
            f"{one.sentence}: add {' or '.join(one.answers)}" for one in self.questions
        )
        return f"{self.where} does not say {asked}."

    def answered(self) -> Sweep:
        """The sweep, with the remarks among its notes; UnsaidError with all that must be said
        first.
        """
        if self.sweep is None:
            raise UnsaidError(self.asked)
        remarks = (f"{MIND}{where_it_is_said(one)}" for one in self.remarks)
        notes = dict.fromkeys((*self.sweep.notes, *remarks))
        return replace(self.sweep, notes=tuple(notes))


def import_files(
    paths: Sequence[str | Path],
    maps: Iterable[str] = (),
    frequency: np.ndarray | None = None,
    **said: Any,
) -> Imported:
    """Read tables of one inverter from files, each with one operating point or several.

    maps : `freq=f,Ydd=ReYdd+jImYdd,p=P`, for the columns whose names do not say it (column_map).
    frequency : (K,) Hz at which a model is sampled; what was measured has its own.
    said : what the files do not say, and wins over them: unit ("pu", "S", "ohm", or
    "pu:100MVA,33kV" for per unit on another
        base), base ("10kVA,400V"; or s_base_va, v_base_v), current, q_axis, voltage_axis,
        frame_deg, power_node, f0_hz, sampling_hz, quantity ("Y", "Z"), sequence_frequency ("dq",
        "network"), op, p, q, v, decimal ("point", "comma"), polar ("deg", "rad").
        `<path>.meta` and comments of the file are read too.

    Raises SweepError: one sentence with file and line, for what cannot be read or understood.
    """
    tables, shared, maps = [], [], tuple(maps)
    unread: list[SweepError] = []
    form, said = number_format(said), without_format(said)
    for path in map(Path, paths):
        response = touchstone_response(path) if suffix_of(path) in TOUCHSTONE else None
        response = pscad_response(path, surely=True) if response is None and not maps else response
        if response is None:
            told, notes = sidecar_keys(path)
            shared += [f"{key}: {value}" for key, value in told.items() if key in HEADER_KEYS]
            try:
                held = read_tables(path, frequency, form)
            except SweepError as reason:
                if named_as_entry(stem_of(path)):
                    raise
                unread.append(reason)
                continue
        else:
            told, notes = response.told, response.notes
            matrix = f"{response.quantity.letter}{'pn' if response.quantity.sequence else ''}"
            entries = {
                f"{matrix}({row + 1},{column + 1})": response.matrix[:, row, column]
                for row, column in np.ndindex(2, 2)
            }
            lines = np.arange(1, len(response.frequency) + 1)
            remarks = tuple(note for note in notes if note.startswith(SCATTERING))
            columns = {"f_dq": response.frequency, **entries}
            held = [ForeignTable(str(path), response.name, columns, lines, remarks=remarks)]
        notes = (*(f"{key}: {value}" for key, value in told.items() if key != "op"), *notes)
        tables += [
            replace(table, notes=(*notes, *table.notes), op=str(told.get("op", "")) or table.op)
            for table in held
        ]
    tables = entries_last(tables)
    if unread and not are_entries_apart(tables):
        raise unread[0]
    tables = without_others(tables)
    beside = [f"not used: {reason}" for reason in unread]
    tables = [
        replace(one, notes=(*one.notes, *shared), remarks=(*one.remarks, *beside)) for one in tables
    ]
    return import_tables(
        tables, maps, **{key: value for key, value in said.items() if value is not None}
    )


def import_tables(
    tables: Sequence[ForeignTable], maps: Iterable[str] = (), **said: Any
) -> Imported:
    """The same from tables that were read already, such as DataFrames
    (foreign_table.frame_table).
    """
    for key in said:
        if key not in SAYABLE:
            raise SweepError(f"{key} is not something to say about a table; {near(key, SAYABLE)}")
    if not tables:
        raise SweepError("a sweep must come from at least one table; found none.")
    account = Account(tuple(maps), dict(said), points=_points_said(said))
    account.said.update(_as_one(account.points, said))
    tables = [without_copied_rows(without_signs(table)) for table in tables]
    tables = [own_block(with_entries(table)) for table in tables]
    tables = [with_rest(table, account.said) for table in tables]
    for remark in (one for table in tables for one in table.remarks):
        account.remark(remark)
    if 0 < max(table.polar_angle for table in tables) <= polar_cells.TURN:
        account.ask(*polar_cells.QUESTION)
    files = list(dict.fromkeys(table.where for table in tables))
    joined = joined_entries([widened(table) for table in tables], account.maps)
    if len(joined) < len(tables):
        account.maps = without_map_of_entry(account.maps)
    tables = joined
    if len(tables) > 1 and {"p", "q"} & said.keys() and not account.said.get("op"):
        raise SweepError(
            f"--p and --q are those of one operating point; found {len(tables)} tables, add "
            f"{OF_EACH}, or --op NAME if all are "
            "one point."
        )
    parts = [part_of(table, account, several=len(tables) > 1) for table in tables]
    parts = operating_points(parts, account)
    _name_points(parts, account)
    if parts[0].told.get("f0_hz") is None:
        ask_of_nominal(parts, account)
    if account.questions:
        ask_of_directions(parts, account)
    where = some(files, 1)
    sweep = None if account.questions else _sweep(parts, account, where)
    if sweep is not None:
        mind_alike_points(sweep, account)
    if (
        sweep is not None
        and len(sweep.points) >= _SINGLE
        and all(len(one.frequency) == 1 for one in sweep.points)
    ):
        account.remark(
            f"each of {len(sweep.points)} operating points has one frequency, which is no sweep: "
            "are p and q of the disturbance "
            "read as the steady state? Name a column of the operating points: --map op=COLUMN"
        )
    if sweep is not None:
        notes = [
            where_it_is_said(f"{what}: {source} {unit}".strip())
            for what, source, unit in account.readings
        ]
        notes += [NOTE] if WORDS in account.remarks else []
        notes += [remark for remark in account.remarks if remark.startswith(MODEL)]
        sweep = replace(sweep, notes=(f"imported from {', '.join(files)}", *notes))
    return Imported(
        tuple(account.readings),
        tuple(account.remarks),
        tuple(account.questions.values()),
        sweep,
        where,
    )


def _points_said(said: Mapping[str, Any]) -> tuple[SaidPoint, ...]:
    """The operating points that `op` tells apart; none where it names one alone."""
    texts = [said["op"]] if isinstance(said.get("op"), str) else list(said.get("op") or ())
    points = tuple(SaidPoint(*point_said(str(text))) for text in texts)
    if any(point.powers for point in points) and (double := {"p", "q", "v"} & said.keys()):
        raise SweepError(
            f"p, q and v must be said once; found --{min(double)} beside --op NAME:p=..,q=.., "
            "leave one out."
        )
    for point in points:
        if point.name and any(
            other.name == point.name and other.powers != point.powers for other in points
        ):
            raise SweepError(
                f"--op {point.name} must be said with one p, q and v; found it twice with other "
                "numbers."
            )
    return points if len(points) > 1 or any(point.name and point.powers for point in points) else ()


def _as_one(points: Sequence[SaidPoint], said: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of one operating point: its name and, where `--op p=..,q=..` says them alone,
    its p, q and v.
    """
    if points or not said.get("op"):
        return {"op": None}
    only = said["op"] if isinstance(said["op"], str) else said["op"][0]
    name, powers = point_said(str(only))
    return {"op": name or None, **{role: (*value, "", "") for role, value in powers.items()}}


def _name_points(parts: list[Part], account: Account) -> None:
    """Every row gets the name of its operating point: the file's, or one made of p, q, v, without
    commas.
    """
    unnamed = [np.flatnonzero(part.names == "") for part in parts]
    powers = [
        np.stack([per_unit(role, part, account) for role in "pqv"], axis=-1)[rows]
        for part, rows in zip(parts, unnamed, strict=True)
        if len(rows)
    ]
    if not powers:
        return
    every = np.concatenate(powers)
    names_made = [_made_name(*every[k].tolist()) for k in first_near(every, _SAME)]
    start = 0
    for index, rows in enumerate(unnamed):
        names = parts[index].names.copy()
        names[rows] = names_made[start : start + len(rows)]
        parts[index] = replace(parts[index], names=names)
        start += len(rows)


def _made_name(p: float, q: float, v: float) -> str:
    return f"p{p:.3g}_q{q:.3g}" + ("" if abs(v - 1) < _SAME else f"_v{v:.3g}")


def _sweep(parts: Sequence[Part], account: Account, where: str) -> Sweep | None:
    """The sweep of all parts, None where there are questions."""
    told = parts[0].told
    f0, bases = number_said(told.get("f0_hz")), None
    needs_base = parts[0].unit != "pu" or any(told.get(key) for key in ("base", "s_base_va"))
    if needs_base:
        bases = bases_of(told, account)
    rows = [_rows(part, account) for part in parts]
    stated = {
        (
            part.unit,
            part.quantity,
            part.counting,
            *(part.told.get(key) for key in CHOICES if key != "unit"),
        )
        for part in parts
    }
    numbers = [{number_said(part.told.get(key)) for part in parts} - {None} for key in POSITIVE]
    if max(map(len, (stated, *numbers))) > 1:
        raise SweepError(
            f"{where}: tables of one inverter must be in one unit, one frame and one convention; "
            "say for all of them what only "
            "some say, or import them one by one, then join: ibrid import ONE.csv TWO.csv --out "
            "ALL.csv."
        )
    if account.questions or f0 is None:
        return None
    table = Table(
        **{name: np.concatenate([vars(one)[name] for one in rows]) for name in vars(rows[0])}
    )
    numbered = np.isfinite(table.repeat).any()
    table = (
        replace(table, repeat=np.nan_to_num(table.repeat))
        if numbered
        else _with_repeats(table, account)
    )
    _require_repeats(table, parts)
    table = in_dq(table, parts[0].counting, f0, account, where)
    keys: dict[str, Any] = {
        "unit": parts[0].unit,
        "f0_hz": f0,
        "power_node": told.get("power_node") or "pcc",
    }
    if bases:
        keys |= {"s_base_va": bases[0], "v_base_v": bases[1]}
    if told.get("sampling_hz"):
        keys["sampling_hz"] = number_said(told["sampling_hz"])
    if not told.get("power_node"):
        account.remark("p and q taken as measured at the PCC (else --power-node capacitor)")

    def made(*directions: str) -> Sweep:
        header = header_of({**keys, **dict(zip(DIRECTIONS, directions, strict=True))}, where)
        return sweep_of_table(table, header, parts[0].quantity, Path(where))

    if (frame_deg := told.get("frame_deg")) is not None:
        keys["frame_deg"] = frame_deg
    else:
        said = (str(told.get(key) or CHOICES[key][0]) for key in DIRECTIONS)
        keys["frame_deg"] = frame_of(made(*said), bool(told.get("current")), account)
    q_first = names_q_first(parts[0].table)
    directions = directions_of(made, told, parts[0].quantity.sequence, q_first, account)
    if account.questions:
        return None
    sweep = made(*directions)
    doubt_nominal(sweep, account)
    return None if account.questions else sweep


def _rows(part: Part, account: Account) -> Table:
    """Rows with one p, q, v for each operating point: their means."""
    powers = np.stack([per_unit(role, part, account) for role in "pqv"], axis=-1)
    for name, rows in rows_of_each(part.names.tolist()).items():
        if np.isnan(powers[rows]).any():
            raise SweepError(
                f"{part.table.where}: operating point {name} must have p, q and v in all its rows; "
                "found an empty cell, fill it, "
                "or leave the column out."
            )
        spread = np.ptp(powers[rows], axis=0).max()
        if spread > 5 * _SAME:
            raise SweepError(
                f"{part.table.where}: operating point {name} must keep one p, q, v; found them to "
                f"vary by {spread:.2g}, "
                "name the column of the operating points: --map op=COLUMN."
            )
        if spread > 1e-9:
            account.remark(f"p, q, v of {name} vary by up to {spread:.2g}: their means are taken")
        powers[rows] = powers[rows].mean(axis=0) if spread > 1e-9 else powers[rows[0]]
    return Table(
        line=part.table.line,
        op=part.names,
        point=powers,
        repeat=part.repeat,
        frequency=part.frequency,
        matrix=part.matrix,
        sigma=part.sigma,
        amplitude=part.amplitude,
    )


def _with_repeats(table: Table, account: Account) -> Table:
    """Frequencies that come several times in an operating point are repeated runs; with amplitudes
    they may be more than that.
    """
    repeat, seen, amplitude = np.zeros(len(table)), {}, np.nan_to_num(table.amplitude).tolist()
    for k, key in enumerate(
        zip(table.op.tolist(), table.frequency.tolist(), amplitude, strict=True)
    ):
        repeat[k] = seen[key] = seen.get(key, 0) + 1
    if repeat.max() == 1:
        return replace(table, repeat=np.zeros(len(table)))
    account.remark(
        f"frequencies come up to {repeat.max():.0f} times in an operating point: taken as repeats"
    )
    return replace(table, repeat=repeat)


def _require_repeats(table: Table, parts: Sequence[Part]) -> None:
    """Raise SweepError where what would be averaged contradicts itself."""
    places = [part.table.where for part in parts for _ in part.names]
    entries = table.matrix.reshape(len(table), -1)
    first: dict[tuple[str, float, float], int] = {}
    pairs: dict[tuple[str, float], list[tuple[int, int]]] = {}
    amplitude = np.nan_to_num(table.amplitude).tolist()
    for k, key in enumerate(
        zip(table.op.tolist(), table.frequency.tolist(), amplitude, strict=True)
    ):
        before = first.setdefault(key, k)
        if before != k:
            pairs.setdefault((key[0], float(table.repeat[k])), []).append((before, k))
    for (name, _), rows in pairs.items():
        before, again = np.array(rows).T
        where = some(dict.fromkeys([places[before[0]], places[again[0]]]), 2)
        both = f"lines {table.line[before[0]]} and {table.line[again[0]]} of {where} ({name})"
        said = any(part.one_point for part in parts)
        require_repeats(entries[before], entries[again], parts[0].counting.frame, both, said=said)
