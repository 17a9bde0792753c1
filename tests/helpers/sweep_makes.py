"""Further files of one sweep: bundles, network forms, long tables, pairs of magnitude and angle of
any naming.
"""

import gzip
import json
import lzma
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from foreign_files import NAMES, Z_BASE, Foreign
from scipy.io import savemat

from ibrid.measurement.sweeps.sweep import Sweep

PU = ("--unit", "pu", "--f0-hz", "60", "--current", "out", "--q-axis", "leads")
BASE = ("--base", "10kVA,400V", "--f0-hz", "60", "--current", "out", "--q-axis", "leads")


def first_point(sweep: Sweep) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Frequencies, matrices and `--p --q` of the first operating point."""
    point = sweep.points[0]
    return point.frequency, point.admittance, ("--p", f"{point.op.p:g}", "--q", f"{point.op.q:g}")


def rows_of(
    names: list[str], columns: list[np.ndarray], mark: str = ",", comma: bool = False
) -> str:
    lines = [
        mark.join(f"{cell:.12g}" for cell in row) for row in np.stack(columns, axis=1).tolist()
    ]
    lines = [line.replace(".", ",") for line in lines] if comma else lines
    return "\n".join([*([mark.join(names)] if names else []), *lines, ""])


def written(folder: Path, name: str, content: str | bytes, encoding: str = "utf-8") -> list[Path]:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return [path]


def parts(matrix: np.ndarray) -> list[np.ndarray]:
    """Real and imaginary parts of the entries of (K, n, n), row by row."""
    return [
        part for value in matrix.reshape(len(matrix), -1).T for part in (value.real, value.imag)
    ]


def polar(matrix: np.ndarray, *, decibel: bool = False, radians: bool = False) -> list[np.ndarray]:
    """Magnitude and angle of the entries, row by row."""
    sizes = [
        20 * np.log10(abs(value)) if decibel else abs(value)
        for value in matrix.reshape(len(matrix), -1).T
    ]
    angles = [np.angle(value, deg=not radians) for value in matrix.reshape(len(matrix), -1).T]
    return [column for pair in zip(sizes, angles, strict=True) for column in pair]


def pairs(
    size: str, angle: str, *, letter: str = "Y", decibel: bool = False, radians: bool = False, **how
) -> Callable:
    """A table of magnitudes and angles; {e} in the names is the entry."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        matrix = np.linalg.inv(matrix) if letter == "Z" else matrix
        names = ["f", *(name.format(e=entry) for entry in NAMES for name in (size, angle))]
        return written(
            folder,
            "scan.csv",
            rows_of(names, [frequency, *polar(matrix, decibel=decibel, radians=radians)], **how),
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
            folder,
            f"{files[0].name}.{kind}",
            {"gz": gzip.compress, "xz": lzma.compress}[kind](files[0].read_bytes()),
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
                value = (
                    matrix[:, r, c]
                    if max(r, c) < 2
                    else np.full(len(frequency), 0.1 * (r - c) + 0.02j)
                )
                names += [f"Y{row}{column}_re", f"Y{row}{column}_im"]
                columns += [value.real, value.imag]
        return written(folder, "ports.csv", rows_of(names, columns))

    return write


def state_space(kind: str) -> Callable:
    """A state space whose response the sweep is compared with: a filter of two states, at 20
    frequencies.
    """

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        arrays = dict(zip("ABCD", MODEL, strict=True))
        if kind == "npz":
            np.savez(folder / "model.npz", **arrays)
            return [folder / "model.npz"]
        if kind == "json":
            return written(
                folder,
                "model.json",
                json.dumps({name: one.tolist() for name, one in arrays.items()}),
            )
        held = {"sys": {**arrays, "Ts": 0.0}} if kind == "ss" else arrays
        savemat(folder / "model.mat", held)
        return [folder / "model.mat"]

    return write


def model_response(frequency: np.ndarray) -> np.ndarray:
    a, b, c, d = MODEL
    return c @ np.linalg.solve(2j * np.pi * frequency[:, None, None] * np.eye(2) - a, b + 0j) + d


def at_rest(names: str) -> Callable:
    """The steady state as v_d, v_q, i_d and i_q in columns."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        op = sweep.points[0].op
        rest = [np.full(len(frequency), value) for value in (1.0, 0.0, op.p, -op.q)]
        names_of = [
            "f",
            *names.split(","),
            *(f"Y{entry}_{part}" for entry in NAMES for part in ("re", "im")),
        ]
        return written(folder, "scan.csv", rows_of(names_of, [frequency, *rest, *parts(matrix)]))

    return write


def impedance_with_dc(sweep: Sweep, folder: Path) -> list[Path]:
    """Z of three ports, whose AC block is not the inverse of the device's own admittance."""
    frequency, matrix, _ = first_point(sweep)
    whole = np.zeros((len(frequency), 3, 3), complex)
    whole[:, :2, :2] = matrix
    whole[:, 0, 2], whole[:, 2, 0], whole[:, 2, 2] = 0.3, -0.4, 0.5 + 0.1j
    ports = ("d", "q", "dc")
    names = [
        "f",
        *(f"Z{row}{column}_{part}" for row in ports for column in ports for part in ("re", "im")),
    ]
    return written(folder, "ports.csv", rows_of(names, [frequency, *parts(np.linalg.inv(whole))]))


def spoilt(
    change: Callable[[np.ndarray], np.ndarray],
    head: str = "f",
    real: str = "Y{e}_re",
    imaginary: str = "Y{e}_im",
) -> Callable:
    """A table of changed matrices."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        names = [head, *(name.format(e=entry) for entry in NAMES for name in (real, imaginary))]
        return written(folder, "scan.csv", rows_of(names, [frequency, *parts(change(matrix))]))

    return write


def half_a_file(sweep: Sweep, folder: Path) -> list[Path]:
    (path,) = plain(sweep, folder)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:10], lines[10][:25], ""]))
    return [path]


#: A, B, C, D: a series inductance of 0.2 per unit at 60 Hz with 0.05 per unit of resistance,
#: current out.
_X, _R, _OMEGA = 0.2, 0.05, 2 * np.pi * 60
MODEL = (
    _OMEGA / _X * np.array([[-_R, _X], [-_X, -_R]]),
    -_OMEGA / _X * np.eye(2),
    np.eye(2),
    np.zeros((2, 2)),
)
_P, _Y = ("--p", "1", "--q", "0.3"), ("--quantity", "Y")
_SAID = (*PU, "--voltage-axis", "d", *_P)
SWEEPS = (
    Foreign("gz", packed(plain, "gz"), _SAID),
    Foreign("xz", packed(plain, "xz"), _SAID),
    Foreign("zip of points", packed(points_of_files, "zip"), PU),
    Foreign("row and column from 0", row_and_column(0), (*_SAID, *_Y)),
    Foreign("row and column from 1", row_and_column(1, "f,i,j,Re,Im"), (*_SAID, *_Y)),
    Foreign(
        "identified beside linearized",
        row_and_column(0, "f,row,column,identified_real,identified_imag"),
        (*_SAID, *_Y),
    ),
    Foreign("magdd and angdd_deg", pairs("mag{e}", "ang{e}_deg"), (*_SAID, *_Y)),
    Foreign("MagnitudeZdd and PhaseZdd", pairs("MagnitudeZ{e}", "PhaseZ{e}", letter="Z"), _SAID),
    Foreign("abs and arg", pairs("abs(Y{e})", "arg(Y{e}) (rad)", radians=True), _SAID),
    Foreign("dB and degrees", pairs("Y{e} [dB]", "Y{e} [deg]", decibel=True), _SAID),
    Foreign("Z_dd_magnitude", pairs("Z_{e}_magnitude", "Z_{e}_phase_deg", letter="Z"), _SAID),
    Foreign("Modulo and Fase", pairs("Modulo Y{e}", "Fase Y{e} (grados)"), _SAID),
    Foreign(
        "Betrag and Winkel", pairs("Betrag Y{e}", "Winkel Y{e} [Grad]", mark=";", comma=True), _SAID
    ),
    Foreign("yddr and yddi", cartesian("y{e}r", "y{e}i"), _SAID),
    Foreign("decimal commas", cartesian("Re Y{e}", "Im Y{e}", mark=";", comma=True), _SAID),
    Foreign("a DC port", more_ports(("dc",)), _SAID),
    Foreign("two DC ports", more_ports(("dc1", "dc2")), _SAID),
    Foreign("an impedance with a DC port", impedance_with_dc, _SAID),
    Foreign("v and i at rest", at_rest("Vd,Vq,Id,Iq"), (*PU, "--voltage-axis", "d")),
    Foreign("v and i at rest, 0 behind", at_rest("vd0,vq0,id0,iq0"), (*PU, "--voltage-axis", "d")),
)
#: State spaces of several makes; each is `MODEL`.
MODELS = tuple(Foreign(kind, state_space(kind), _SAID) for kind in ("mat", "ss", "npz", "json"))
#: Wrong on purpose -> what must be said.
SPOILT = (
    (Foreign("rows exchanged", spoilt(lambda y: y[:, ::-1]), _SAID), "probably exchanged"),
    (Foreign("half a file", half_a_file, _SAID), "is the file cut off"),
    (Foreign("siemens as per unit", spoilt(lambda y: y / Z_BASE), _SAID), "check unit and base"),
    (Foreign("kHz for Hz", spoilt(lambda y: y, "f [kHz]"), _SAID), "Hz taken as kHz"),
    (
        Foreign("the current counted into the device", spoilt(lambda y: -y), _SAID),
        "counted the other way",
    ),
    (Foreign("degrees called rad", pairs("Y{e}_mag", "Y{e}_rad"), _SAID), "which are degrees"),
    (
        Foreign(
            "a base ten times too large",
            spoilt(lambda y: y / Z_BASE),
            ("--unit", "S", "--base", "100kVA,400V", *_SAID[2:]),
        ),
        "check unit and base",
    ),
)
