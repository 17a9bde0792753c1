"""The sweep file of this project: CSV with `# key: value` lines first; read in any convention, written in ours."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conversions import to_ours
from ibrid.measurement.csv_columns import ENTRIES, Columns, columns_of
from ibrid.measurement.files import read_lines, write_atomically
from ibrid.measurement.header import Header, header_of, header_values, known_keys, number_of, read_keys
from ibrid.measurement.repeats import sigma_of_mean
from ibrid.measurement.sweep import OperatingPoint, PointSweep, Sweep

#: Amplitudes further apart than this factor are different ones; nearer ones are one amplitude, repeated.
APART = 1.2


@dataclass(frozen=True)
class _Row:
    line: int
    op: OperatingPoint
    repeat: int
    frequency: float
    matrix: list[complex]
    sigma: list[float] | None
    amplitude: float | None


def read_csv(path: str | Path, **keys: object) -> Sweep:
    """Read a sweep from CSV and convert it to per unit, current out of the inverter, q axis leading.

    Columns: op, p, q, freq_hz and one family of Ydd_re .. Yqq_im, Zdd_re .. (inverted), Ypp_re, Ypn_re .. Ynn_im or
    Zpp_re .. (modified sequences at dq frequency f: p at f + f0, n at f - f0); optional v, sigma or sigma_dd ..
    sigma_qq (sigma_pp ..), repeat, amplitude. Lines `# key: value` with f0_hz, unit, current, q_axis, power_node,
    s_base_va, v_base_v, sampling_hz say how they are meant; other comments are kept as notes.

    Rows at the same frequency with amplitudes more than a fifth apart are different sweeps of one operating point: the
    smallest is the point, the others are its `larger` ones (amplitudes.at_amplitudes).

    Repeats become their mean. Its sigma comes from the sigma columns (of single runs) or, with three runs or more, from
    the scatter of the runs (repeats.sigma_of_mean).

    keys : header keys that the file lacks or has wrong; they win over the file.

    Raises SweepError naming file and line.
    """
    path = Path(path)
    lines = read_lines(path)
    comments = [(number, line.lstrip()[1:]) for number, line in enumerate(lines, 1) if line.lstrip().startswith("#")]
    found, notes = read_keys(comments, str(path))
    header = header_of({**found, **known_keys(keys)}, str(path), notes)
    body = [
        (number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")
    ]
    if not body:
        raise SweepError(f"{path} must hold a line of column names and rows of numbers; found only comments.")
    columns = columns_of(_fields(*body[0], path), f"{path} line {body[0][0]}")
    if len(body) == 1:
        raise SweepError(f"{path} must hold rows of numbers; found only the column names in line {body[0][0]}.")
    rows = [_row(number, _fields(number, line, path), columns, path) for number, line in body[1:]]
    return Sweep(
        points=tuple(_point_at_amplitudes(group, header, columns, path) for group in _by_operating_point(rows, path)),
        f0_hz=header.f0_hz,
        power_node=header.power_node,
        s_base_va=header.s_base_va,
        v_base_v=header.v_base_v,
        notes=notes,
        source=str(path),
        sampling_hz=header.sampling_hz,
    )


def _fields(number: int, line: str, path: Path) -> list[str]:
    if '"' not in line:
        return [field.strip() for field in line.split(",")]
    try:
        return [field.strip() for field in next(csv.reader([line], strict=True))]
    except csv.Error as reason:
        raise SweepError(
            f"{path} line {number} must be comma-separated values; {reason}, check the quotes."
        ) from reason


def _row(number: int, fields: list[str], columns: Columns, path: Path) -> _Row:
    where = f"{path} line {number}"
    if len(fields) != columns.count:
        hint = "decimal commas?" if len(fields) > columns.count else "is the line cut off?"
        raise SweepError(f"{where} must have {columns.count} values, one per column; found {len(fields)}, {hint}")

    def cell(name: str) -> float:
        return number_of(fields[columns.place[name]], f"{where}: {name}")

    def optional(name: str) -> float | None:
        return cell(name) if name in columns.place and fields[columns.place[name]] else None

    frequency = cell("freq_hz")
    if frequency <= 0:
        raise SweepError(f"{where}: freq_hz must be positive; found {frequency:g}, leave that row out.")
    repeat = optional("repeat")
    if repeat is not None and repeat != int(repeat):
        raise SweepError(f"{where}: repeat must be a whole number; found {repeat:g}.")
    sigma = [optional(name) for name in columns.sigma]
    if any(value is not None and value <= 0 for value in sigma):
        raise SweepError(f"{where}: sigma must be positive; leave the cell empty where the noise is unknown.")
    p, q, v = cell("p"), cell("q"), optional("v")
    try:
        op = OperatingPoint(fields[columns.place["op"]], p, q, 1.0 if v is None else v)
    except SweepError as reason:
        raise SweepError(f"{where}: {reason}") from reason
    return _Row(
        line=number,
        op=op,
        repeat=int(repeat or 0),
        frequency=frequency,
        matrix=[complex(cell(real), cell(imaginary)) for real, imaginary in columns.matrix],
        sigma=None if not sigma or None in sigma else [value for value in sigma if value is not None],
        amplitude=optional("amplitude"),
    )


def _by_operating_point(rows: list[_Row], path: Path) -> list[list[_Row]]:
    """Rows per operating point in order of appearance; one name means one steady state."""
    groups: dict[str, list[_Row]] = {}
    for row in rows:
        group = groups.setdefault(row.op.name, [])
        group.append(row)
        first, again = group[0].op, row.op
        if not np.allclose((first.p, first.q, first.v), (again.p, again.q, again.v), rtol=1e-9, atol=1e-12):
            raise SweepError(
                f"{path} line {row.line}: operating point {again.name} must keep one p, q, v; found p={again.p:g}, "
                f"q={again.q:g}, v={again.v:g} after p={first.p:g}, q={first.q:g}, v={first.v:g} "
                f"in line {group[0].line}, give the second setpoint a name of its own."
            )
    return list(groups.values())


def _point_at_amplitudes(rows: list[_Row], header: Header, columns: Columns, path: Path) -> PointSweep:
    smallest, *larger = (_point(level, header, columns, path) for level in _by_amplitude(rows, path))
    return replace(smallest, larger=tuple(larger))


def _by_amplitude(rows: list[_Row], path: Path) -> list[list[_Row]]:
    """Rows of one operating point by the rank of their amplitude at their frequency, the smallest first."""
    empty = [row for row in rows if row.amplitude is None]
    if len(empty) == len(rows):
        return [rows]
    if empty:
        raise SweepError(
            f"{path} line {empty[0].line}: amplitude must be there in all rows of operating point {rows[0].op.name} "
            "or in none."
        )
    levels: dict[int, list[_Row]] = {}
    by_frequency: dict[float, list[tuple[float, _Row]]] = {}
    for row in rows:
        by_frequency.setdefault(row.frequency, []).append((row.amplitude or 0.0, row))
    for found in by_frequency.values():
        found.sort(key=lambda one: one[0])
        rank, first = 0, found[0][0]
        for amplitude, row in found:
            if first <= 0 and amplitude != first:
                raise SweepError(
                    f"{path} line {row.line}: amplitude must be positive where there are several; found {first:g} too."
                )
            if amplitude > APART * first > 0:
                rank, first = rank + 1, amplitude
            levels.setdefault(rank, []).append(row)
    return [sorted(level, key=lambda row: row.line) for _, level in sorted(levels.items())]


def _point(rows: list[_Row], header: Header, columns: Columns, path: Path) -> PointSweep:
    runs: dict[int, list[_Row]] = {}
    for row in rows:
        runs.setdefault(row.repeat, []).append(row)
    sorted_runs = [_sorted_run(run, path) for run in runs.values()]
    frequency = np.array([row.frequency for row in sorted_runs[0]])
    for run in sorted_runs[1:]:
        if len(run) != len(frequency) or (np.array([row.frequency for row in run]) != frequency).any():
            raise SweepError(
                f"{path} line {run[0].line}: repeat {run[0].repeat} of operating point {rows[0].op.name} must have "
                f"the same frequencies as repeat {sorted_runs[0][0].repeat}; complete it or leave it out."
            )
    converted = [_convert(run, header, columns, path) for run in sorted_runs]
    repeats = np.array([matrix for matrix, _ in converted])
    single = [sigma for _, sigma in converted if sigma is not None]
    if single:
        if len(single) != len(converted):
            raise SweepError(
                f"{path}: sigma of operating point {rows[0].op.name} must be given for all repeats or none."
            )
        sigma = np.sqrt((np.array(single) ** 2).sum(axis=0)) / len(single)
    else:
        sigma = sigma_of_mean(repeats) if len(repeats) >= 3 else None
    try:
        return PointSweep(
            op=rows[0].op,
            frequency=frequency,
            admittance=repeats.mean(axis=0),
            sigma=sigma,
            repeats=repeats if len(repeats) > 1 else None,
            amplitude=_amplitude(sorted_runs),
        )
    except SweepError as reason:
        raise SweepError(f"{path} line {rows[0].line}: {reason}") from reason


def _sorted_run(run: list[_Row], path: Path) -> list[_Row]:
    run = sorted(run, key=lambda row: row.frequency)
    for earlier, later in pairwise(run):
        if earlier.frequency == later.frequency:
            first, second = sorted((earlier.line, later.line))
            raise SweepError(
                f"{path} line {second}: {later.frequency:g} Hz must be there once per operating point and repeat; "
                f"{later.op.name} has it in line {first} already, number the runs in a column repeat."
            )
    return run


def _convert(run: list[_Row], header: Header, columns: Columns, path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    matrix = np.array([row.matrix for row in run]).reshape(-1, 2, 2)
    sigma = None
    without = [row.line for row in run if row.sigma is None]
    if not without:
        sigma = np.array([row.sigma for row in run])
        sigma = np.broadcast_to(sigma.reshape(len(run), -1), (len(run), 4)).reshape(-1, 2, 2)
    elif len(without) < len(run):
        raise SweepError(
            f"{path} line {without[0]}: sigma must be there in all rows of operating point {run[0].op.name} or in none."
        )
    return to_ours(matrix, sigma, header, columns.quantity, lambda k: f"{path} line {run[k].line}")


def _amplitude(runs: list[list[_Row]]) -> np.ndarray | None:
    """Injected amplitude per frequency, averaged over the repeats of one amplitude; None where it is not told."""
    values = [[row.amplitude for row in run if row.amplitude is not None] for run in runs]
    return np.array(values, dtype=float).mean(axis=0) if values[0] else None


def write_sweep(sweep: Sweep, path: str | Path, *, header: Sequence[str] = ()) -> None:
    """Write a sweep as CSV: per unit, current out, q leads, all digits; the file appears whole or not at all.

    header : further comment lines, without "#", put first; the sweep's notes follow.

    Raises SweepError when the file cannot be written.
    """
    write_atomically(Path(path), sweep_csv(sweep, header=header))


def sweep_csv(sweep: Sweep, *, header: Sequence[str] = ()) -> str:
    """The text that `write_sweep` writes.

    Columns v, sigma_dd .. sigma_qq, repeat and amplitude are there when they carry information. With repeats each run
    is a row and sigma is that of a single run, so that reading gives the same mean and the same sigma of the mean.
    """
    meant = Header(
        f0_hz=sweep.f0_hz,
        power_node=sweep.power_node,
        s_base_va=sweep.s_base_va,
        v_base_v=sweep.v_base_v,
        sampling_hz=sweep.sampling_hz,
    )
    lines = [f"# {_as_note(line)}".rstrip() for text in (*header, *sweep.notes) for line in str(text).splitlines()]
    lines += [f"# {key}: {value}" for key, value in header_values(meant).items()]
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    every = [one for point in sweep.points for one in (point, *point.larger)]
    optional = {
        "v": any(point.op.v != 1.0 for point in sweep.points),
        "sigma": any(point.sigma is not None for point in every),
        "repeat": any(point.repeats is not None for point in every),
        "amplitude": any(point.amplitude is not None for point in every),
    }
    names = ["op", "p", "q", *(["v"] if optional["v"] else []), "freq_hz"]
    names += [f"Y{entry}_{part}" for entry in ENTRIES["dq"] for part in ("re", "im")]
    names += [f"sigma_{entry}" for entry in ENTRIES["dq"]] if optional["sigma"] else []
    names += [name for name in ("repeat", "amplitude") if optional[name]]
    writer.writerow(names)
    for point in every:
        writer.writerows(_rows_of(point, optional))
    return ("\n".join(lines) + "\n" if lines else "") + table.getvalue()


def _as_note(line: str) -> str:
    """A comment that would be read as a key is marked as a note: our numbers are meant as the keys below it say."""
    try:
        keys, _ = read_keys([(0, line)], "header")
    except SweepError:
        return f"note - {line}"
    return f"note - {line}" if keys else line


def _rows_of(point: PointSweep, optional: dict[str, bool]) -> list[list[object]]:
    runs = point.admittance[None] if point.repeats is None else point.repeats
    sigma = None if point.sigma is None else (point.sigma * np.sqrt(len(runs))).reshape(-1, 4)
    rows: list[list[object]] = []
    for number, run in enumerate(runs, 1):
        for k, frequency in enumerate(point.frequency):
            row: list[object] = [point.op.name, repr(float(point.op.p)), repr(float(point.op.q))]
            row += [repr(float(point.op.v))] if optional["v"] else []
            row.append(repr(float(frequency)))
            row += [repr(float(part)) for entry in run[k].ravel() for part in (entry.real, entry.imag)]
            if optional["sigma"]:
                row += [""] * 4 if sigma is None else [repr(float(value)) for value in sigma[k]]
            row += [number] if optional["repeat"] else []
            if optional["amplitude"]:
                row.append("" if point.amplitude is None else repr(float(point.amplitude[k])))
            rows.append(row)
    return rows
