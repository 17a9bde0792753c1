"""Further files of one sweep: bundles, network forms, long tables, pairs of magnitude and angle of any naming."""

import gzip
import lzma
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from foreign_files import NAMES, Foreign

from ibrid.measurement.sweeps.sweep import Sweep

PU = ("--unit", "pu", "--f0-hz", "60", "--current", "out", "--q-axis", "leads")
BASE = ("--base", "10kVA,400V", "--f0-hz", "60", "--current", "out", "--q-axis", "leads")
POINTS = ("--op", "p=1,q=0.3", "--op", "p=0.5,q=0")


def first_point(sweep: Sweep) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Frequencies, matrices and `--p --q` of the first operating point."""
    point = sweep.points[0]
    return point.frequency, point.admittance, ("--p", f"{point.op.p:g}", "--q", f"{point.op.q:g}")


def rows_of(names: list[str], columns: list[np.ndarray], mark: str = ",", comma: bool = False) -> str:
    lines = [mark.join(f"{cell:.12g}" for cell in row) for row in np.stack(columns, axis=1).tolist()]
    lines = [line.replace(".", ",") for line in lines] if comma else lines
    return "\n".join([*([mark.join(names)] if names else []), *lines, ""])


def written(folder: Path, name: str, content: str | bytes, encoding: str = "utf-8") -> list[Path]:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return [path]


def parts(matrix: np.ndarray) -> list[np.ndarray]:
    """Real and imaginary parts of the entries of (K, n, n), row by row."""
    return [part for value in matrix.reshape(len(matrix), -1).T for part in (value.real, value.imag)]


def polar(matrix: np.ndarray, *, decibel: bool = False, radians: bool = False) -> list[np.ndarray]:
    """Magnitude and angle of the entries, row by row."""
    sizes = [20 * np.log10(abs(value)) if decibel else abs(value) for value in matrix.reshape(len(matrix), -1).T]
    angles = [np.angle(value, deg=not radians) for value in matrix.reshape(len(matrix), -1).T]
    return [column for pair in zip(sizes, angles, strict=True) for column in pair]


def pairs(size: str, angle: str, *, letter: str = "Y", decibel: bool = False, radians: bool = False, **how) -> Callable:
    """A table of magnitudes and angles; {e} in the names is the entry."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        matrix = np.linalg.inv(-matrix) if letter == "Z" else matrix
        names = ["f", *(name.format(e=entry) for entry in NAMES for name in (size, angle))]
        return written(
            folder, "scan.csv", rows_of(names, [frequency, *polar(matrix, decibel=decibel, radians=radians)], **how)
        )

    return write


def cartesian(real: str, imaginary: str, **how) -> Callable:
    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        names = ["f", *(name.format(e=entry) for entry in NAMES for name in (real, imaginary))]
        return written(folder, "scan.csv", rows_of(names, [frequency, *parts(matrix)], **how))

    return write


def row_and_column(first: int, names: str = "frequency_hz,row,column,real,imag") -> Callable:
    """A long table: row and column of the entry as numbers from 0 or 1."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        lines = [names]
        for f, y in zip(frequency, matrix, strict=True):
            lines += [
                f"{f:.12g},{r + first},{c + first},{y[r, c].real:.12g},{y[r, c].imag:.12g}"
                for r in (0, 1)
                for c in (0, 1)
            ]
        return written(folder, "long.csv", "\n".join([*lines, ""]))

    return write


def plain(sweep: Sweep, folder: Path) -> list[Path]:
    return cartesian("Y{e}_re", "Y{e}_im")(sweep, folder)


def packed(write: Callable, kind: str) -> Callable:
    def packed_write(sweep: Sweep, folder: Path) -> list[Path]:
        files = write(sweep, folder)
        if kind == "zip":
            with zipfile.ZipFile(folder / "all.zip", "w", zipfile.ZIP_DEFLATED) as archive:
                for path in files:
                    archive.write(path, f"scans/{path.name}")
            return [folder / "all.zip"]
        return written(
            folder, f"{files[0].name}.{kind}", {"gz": gzip.compress, "xz": lzma.compress}[kind](files[0].read_bytes())
        )

    return packed_write


def points_of_files(sweep: Sweep, folder: Path) -> list[Path]:
    """A file for each operating point, p and q in its name."""
    files = []
    for point in sweep.points:
        names = ["f", *(f"Y{entry}_{part}" for entry in NAMES for part in ("re", "im"))]
        name = f"scan_P{point.op.p:g}_Q{point.op.q:g}.csv"
        files += written(folder, name, rows_of(names, [point.frequency, *parts(point.admittance)]))
    return files


def more_ports(others: tuple[str, ...]) -> Callable:
    """The device has further ports: dc, or a second terminal."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        ports = ["d", "q", *others]
        names, columns = ["f"], [frequency]
        for r, row in enumerate(ports):
            for c, column in enumerate(ports):
                value = matrix[:, r, c] if max(r, c) < 2 else np.full(len(frequency), 0.1 * (r - c) + 0.02j)
                names += [f"Y{row}{column}_re", f"Y{row}{column}_im"]
                columns += [value.real, value.imag]
        return written(folder, "ports.csv", rows_of(names, columns))

    return write


SWEEPS = (
    Foreign("gz", packed(plain, "gz"), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("xz", packed(plain, "xz"), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("zip of points", packed(points_of_files, "zip"), PU),
    Foreign("row, column from 0", row_and_column(0), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("row, column from 1", row_and_column(1, "f,i,j,Re,Im"), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("angdd_deg", pairs("mag{e}", "ang{e}_deg"), (*PU, "--quantity", "Y", "--p", "1", "--q", "0.3")),
    Foreign("MagnitudeZdd, PhaseZdd", pairs("MagnitudeZ{e}", "PhaseZ{e}", letter="Z"), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("abs, arg", pairs("abs(Y{e})", "arg(Y{e}) (rad)", radians=True), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("dB, deg", pairs("Y{e} [dB]", "Y{e} [deg]", decibel=True), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("Z_dd|mag", pairs("Z_{e}_magnitude", "Z_{e}_phase_deg", letter="Z"), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("three ports", more_ports(("dc",)), (*PU, "--p", "1", "--q", "0.3")),
    Foreign("decimal commas", cartesian("Re Y{e}", "Im Y{e}", mark=";", comma=True), (*PU, "--p", "1", "--q", "0.3")),
)
