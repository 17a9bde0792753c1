"""The sweep file of this project: CSV with `# key: value` lines first; read in any convention,
written in ours.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError
from ibrid.foreign_text import csv_text
from ibrid.measurement.conventions.conversions import Quantity, to_ours
from ibrid.measurement.conventions.header import (
    Header,
    header_of,
    header_values,
    known_keys,
    read_keys,
)
from ibrid.measurement.formats.csv_columns import ENTRIES, columns_of
from ibrid.measurement.formats.csv_table import (
    Table,
    comments_and_body,
    fields_of,
    read_table,
    require_body,
)
from ibrid.measurement.formats.files import read_lines, write_atomically
from ibrid.measurement.sweeps.noise import sigma_of_mean
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep

#: Amplitudes further apart than this factor are different ones; nearer ones are one amplitude,
#: repeated.
APART = 1.2


@takes_kinds
def read_csv(path: str | Path, **keys: object) -> Sweep:
    """Read a sweep from CSV and convert it to per unit, current out of the inverter, q axis
    leading.

    Columns: op, p, q, freq_hz and one family of Ydd_re .. Yqq_im, Zdd_re .. (inverted), Ypp_re,
    Ypn_re .. Ynn_im or Zpp_re .. (modified sequences at dq frequency f: p at f + f0, n at f - f0);
    optional v, sigma or sigma_dd .. sigma_qq (sigma_pp ..), repeat, amplitude. Lines `# key: value`
    with f0_hz, unit, current, q_axis, voltage_axis, frame_deg, power_node, s_base_va, v_base_v,
    sampling_hz say how they are meant; other comments are kept as notes.

    Rows at the same frequency with amplitudes more than a fifth apart are different sweeps of one
    operating point: the smallest is the point, the others are its `larger` ones
    (amplitudes.at_amplitudes).

    Repeats become their mean. Its sigma comes from the sigma columns (of single runs) or, with
    three runs or more, from the scatter of the runs (noise.sigma_of_mean).

    keys : header keys that the file lacks or has wrong; they win over the file.

    Raises SweepError naming file and line.
    """
    return parse_csv(read_lines(Path(path)), Path(path), keys)


def parse_csv(lines: Sequence[str], path: Path, keys: Mapping[str, object]) -> Sweep:
    """The same from the lines of a file; path : for errors, and the sweep's source."""
    comments, body = comments_and_body(lines)
    found, notes = read_keys(comments, str(path))
    header = header_of({**found, **known_keys(keys)}, str(path), notes)
    require_body(body, str(path))
    head, *numbers = body
    columns = columns_of(fields_of(head, lines[head - 1], path), f"{path} line {head}")
    require_body(body, str(path), rows=True)
    table = read_table(numbers, [lines[number - 1] for number in numbers], columns, path)
    return sweep_of_table(table, header, columns.quantity, path)


def sweep_of_table(table: Table, header: Header, quantity: Quantity, path: Path) -> Sweep:
    """The sweep that rows make, in our convention. path : for errors, and the sweep's source."""
    groups = _by_operating_point(table, path)
    return header.sweep(
        [_point_at_amplitudes(group, header, quantity, path) for group in groups], str(path)
    )


def _by_operating_point(table: Table, path: Path) -> list[Table]:
    """Rows per operating point in order of appearance; one name means one steady state."""
    groups = table.grouped(table.op)
    for group in groups:
        other = np.flatnonzero(
            ~np.isclose(group.point, group.point[0], rtol=1e-9, atol=1e-12).all(axis=1)
        )
        if len(other):
            (p, q, v), (p_again, q_again, v_again) = group.point[0], group.point[other[0]]
            raise SweepError(
                f"{path} line {group.line[other[0]]}: operating point {group.op[0]} must keep one "
                "p, q, v; found "
                f"p={p_again:g}, q={q_again:g}, v={v_again:g} after p={p:g}, q={q:g}, v={v:g} "
                f"in line {group.line[0]}, give the second setpoint a name of its own."
            )
    return groups


def _point_at_amplitudes(rows: Table, header: Header, quantity: Quantity, path: Path) -> PointSweep:
    smallest, *larger = (
        _point(level, header, quantity, path) for level in _by_amplitude(rows, path)
    )
    return replace(smallest, larger=tuple(larger))


def _by_amplitude(rows: Table, path: Path) -> list[Table]:
    """Rows of one operating point by the rank of their amplitude at their frequency, the smallest
    first.
    """
    empty = np.isnan(rows.amplitude)
    if empty.all():
        return [rows]
    if empty.any():
        raise SweepError(
            f"{path} line {rows.line[np.argmax(empty)]}: amplitude must be there in all rows of "
            "operating point "
            f"{rows.op[0]} or in none."
        )
    level = np.zeros(len(rows), dtype=int)
    rank, first, frequency = 0, 0.0, 0.0
    for k in np.lexsort((rows.amplitude, rows.frequency)):
        amplitude = rows.amplitude[k]
        if rows.frequency[k] != frequency:
            rank, first, frequency = 0, amplitude, rows.frequency[k]
        if first <= 0 and amplitude != first:
            raise SweepError(
                f"{path} line {rows.line[k]}: amplitude must be positive where there are several; "
                f"found {first:g} too."
            )
        if amplitude > APART * first > 0:
            rank, first = rank + 1, amplitude
        level[k] = rank
    return [rows.at(level == rank) for rank in range(level.max() + 1)]


def _point(rows: Table, header: Header, quantity: Quantity, path: Path) -> PointSweep:
    runs = [_sorted_run(run, path) for run in rows.grouped(rows.repeat)]
    frequency = runs[0].frequency
    for run in runs[1:]:
        if len(run) != len(frequency) or (run.frequency != frequency).any():
            raise SweepError(
                f"{path} line {run.line[0]}: repeat {run.repeat[0]:.0f} of operating point "
                f"{rows.op[0]} must have "
                f"the same frequencies as repeat {runs[0].repeat[0]:.0f}; found {len(run)} of "
                f"{len(frequency)}, {run.frequency[0]:g} Hz first, complete it or leave out what "
                "stands twice."
            )
    converted = [_convert(run, header, quantity, path) for run in runs]
    repeats = np.array([matrix for matrix, _ in converted])
    single = [sigma for _, sigma in converted if sigma is not None]
    if single:
        if len(single) != len(converted):
            raise SweepError(
                f"{path}: sigma of operating point {rows.op[0]} must be given for all repeats or "
                "none."
            )
        sigma = np.sqrt((np.array(single) ** 2).sum(axis=0)) / len(single)
    else:
        sigma = sigma_of_mean(repeats) if len(repeats) >= 3 else None
    told = not np.isnan(rows.amplitude).any()
    try:
        return PointSweep(
            op=OperatingPoint(rows.op[0], *rows.point[0].tolist()),
            frequency=frequency,
            admittance=repeats.mean(axis=0),
            sigma=sigma,
            repeats=repeats if len(repeats) > 1 else None,
            amplitude=np.mean([run.amplitude for run in runs], axis=0) if told else None,
        )
    except SweepError as reason:
        raise SweepError(f"{path} line {rows.line[0]}: {reason}") from reason


def _sorted_run(run: Table, path: Path) -> Table:
    run = run.at(np.argsort(run.frequency, kind="stable"))
    twice = np.flatnonzero(np.diff(run.frequency) == 0)
    if len(twice):
        first, second = sorted(run.line[twice[0] : twice[0] + 2])
        raise SweepError(
            f"{path} line {second}: {run.frequency[twice[0]]:g} Hz must be there once per "
            "operating point and repeat; "
            f"{run.op[0]} has it in line {first} already, number the runs in a column repeat."
        )
    return run


def _convert(
    run: Table, header: Header, quantity: Quantity, path: Path
) -> tuple[np.ndarray, np.ndarray | None]:
    sigma = None
    without = run.line[np.isnan(run.sigma).any(axis=1)] if run.sigma.size else run.line
    if not len(without):
        sigma = np.broadcast_to(run.sigma, (len(run), 4)).reshape(-1, 2, 2)
    elif len(without) < len(run):
        raise SweepError(
            f"{path} line {without[0]}: sigma must be there in all rows of operating point "
            f"{run.op[0]} or in none."
        )
    return to_ours(run.matrix, sigma, header, quantity, lambda k: f"{path} line {run.line[k]}")


@takes_kinds
def write_sweep(sweep: Sweep, path: str | Path, *, header: Sequence[str] = ()) -> None:
    """Write a sweep as CSV: per unit, current out, q leads, all digits; the file appears whole or
    not at all.

    header : further comment lines, without "#", put first; the sweep's notes follow.

    Raises SweepError when the file cannot be written.
    """
    write_atomically(Path(path), sweep_csv(sweep, header=header))


def sweep_csv(sweep: Sweep, *, header: Sequence[str] = ()) -> str:
    """The text that `write_sweep` writes.

    Columns v, sigma_dd .. sigma_qq, repeat and amplitude are there when they carry information.
    With repeats each run is a row and sigma is that of a single run, so that reading gives the same
    mean and the same sigma of the mean.
    """
    lines = [
        f"# {_as_note(line)}".rstrip()
        for text in (*header, *sweep.notes)
        for line in str(text).splitlines()
    ]
    lines += [f"# {key}: {value}" for key, value in header_values(Header.of(sweep)).items()]
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
    return csv_text([names, *(row for point in every for row in _rows_of(point, optional))], lines)


def _as_note(line: str) -> str:
    """A comment that would be read as a key is marked as a note: our numbers are meant as the keys
    below it say.
    """
    try:
        keys, _ = read_keys([(0, line)], "header")
    except SweepError:
        return f"note - {line}"
    return f"note - {line}" if keys else line


def _rows_of(point: PointSweep, optional: dict[str, bool]) -> list[list[object]]:
    runs = point.admittance[None] if point.repeats is None else point.repeats
    sigma = None if point.sigma is None else (point.sigma * np.sqrt(len(runs))).reshape(-1, 4)
    at = [point.op.p, point.op.q, *([point.op.v] if optional["v"] else [])]
    rows: list[list[object]] = []
    for number, run in enumerate(runs, 1):
        for k, frequency in enumerate(point.frequency):
            row: list[object] = [
                point.op.name,
                *_digits([*at, frequency, *run[k].ravel().view(float)]),
            ]
            if optional["sigma"]:
                row += [""] * 4 if sigma is None else _digits(sigma[k])
            row += [number] if optional["repeat"] else []
            if optional["amplitude"]:
                row += [""] if point.amplitude is None else _digits([point.amplitude[k]])
            rows.append(row)
    return rows


def _digits(values: Iterable[float]) -> list[str]:
    """All digits of each."""
    return [repr(float(value)) for value in values]
