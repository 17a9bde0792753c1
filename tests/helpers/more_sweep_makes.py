"""A further pass of sweeps, models and spoilt files: words of four languages, operating points told
in names of files, first lines and options, models of several programs.
"""

import json
import lzma
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from foreign_files import NAMES, Z_BASE, Foreign
from scipy.io import savemat
from sweep_makes import (
    BASE,
    MODEL,
    PU,
    cartesian,
    first_point,
    packed,
    pairs,
    parts,
    plain,
    rows_of,
    spoilt,
    written,
)

from ibrid.measurement.sweeps.sweep import Sweep

_D = ("--voltage-axis", "d")
_POINT = ("--p", "1", "--q", "0.3")
_SAID = (*PU, *_D, *_POINT)
_PLAIN = [f"Y{entry}_{part}" for entry in NAMES for part in ("re", "im")]


def headed(*above: str, **how) -> Callable:
    """The first point under lines that say something of it."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        body = rows_of(["f", *_PLAIN], [frequency, *parts(matrix)], **how)
        return written(folder, "scan.csv", "\n".join([*above, body]))

    return write


def named_files(form: str) -> Callable:
    """A file for each operating point; {p} and {q} stand in its name."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        files = []
        for point in sweep.points:
            name = form.format(p=point.op.p, q=point.op.q)
            columns = [point.frequency, *parts(point.admittance)]
            files += written(folder, name, rows_of(["f", *_PLAIN], columns))
        return files

    return write


def columns_named(
    head: str, real: str, imaginary: str, p: str, q: str, *, encoding: str = "utf-8", **how
) -> Callable:
    """Columns for frequency, p, q and the parts of all entries."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        names = [head, p, q]
        names += [name.format(e=entry) for entry in NAMES for name in (real, imaginary)]
        op = sweep.points[0].op
        powers = [np.full(len(frequency), one) for one in (op.p, op.q)]
        text = rows_of(names, [frequency, *powers, *parts(matrix)], **how)
        return written(folder, "scan.csv", text, encoding)

    return write


def complex_cells(form: str, mark: str = ",") -> Callable:
    """Complex numbers as text in one cell."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        lines = [mark.join(["f", *(f"Y{entry}" for entry in NAMES)])]
        for hertz, row in zip(frequency, matrix.reshape(-1, 4), strict=True):
            cells = [
                form.format(re=value.real, im=value.imag, abs=abs(value.imag)) for value in row
            ]
            lines.append(mark.join([f"{hertz:.12g}", *cells]))
        return written(folder, "scan.csv", "\n".join([*lines, ""]))

    return write


def lettered_rows(sweep: Sweep, folder: Path) -> list[Path]:
    """A long table whose row and column are d and q, with magnitude and angle."""
    frequency, matrix, _ = first_point(sweep)
    lines = ["freq_hz,output,input,magnitude,phase_deg"]
    for hertz, y in zip(frequency, matrix, strict=True):
        for r, c in np.ndindex(2, 2):
            angle = np.degrees(np.angle(y[r, c]))
            lines.append(f"{hertz:.12g},{'dq'[r]},{'dq'[c]},{abs(y[r, c]):.12g},{angle:.12g}")
    return written(folder, "long.csv", "\n".join([*lines, ""]))


def rest_beside(sweep: Sweep, folder: Path) -> list[Path]:
    """v_d, v_q, i_d and i_q of the steady state in the first lines, peak values of a phase."""
    op = sweep.points[0].op
    volt, ampere = 400 * np.sqrt(2 / 3), 2 / 3 * 10e3 / (400 * np.sqrt(2 / 3))
    above = [f"# Vd0 = {volt:.12g} V", "# Vq0 = 0 V"]
    above += [f"# Id0 = {op.p * ampere:.12g} A", f"# Iq0 = {-op.q * ampere:.12g} A"]
    frequency, matrix, _ = first_point(sweep)
    body = rows_of(["f", *_PLAIN], [frequency, *parts(matrix / Z_BASE)])
    return written(folder, "scan.csv", "\n".join([*above, body]))


def unit_of_columns(unit: str, factor: float) -> Callable:
    """Admittances in a unit of their columns."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        frequency, matrix, _ = first_point(sweep)
        names = [f"{part} Y{e} [{unit}]" for e in NAMES for part in ("Re", "Im")]
        text = rows_of(["f [Hz]", *names], [frequency, *parts(matrix / Z_BASE / factor)])
        return written(folder, "scan.csv", text)

    return write


def zipped_book(sweep: Sweep, folder: Path) -> list[Path]:
    """A workbook in an archive."""
    import pandas

    frequency, matrix, _ = first_point(sweep)
    columns = [frequency, *parts(matrix)]
    frame = pandas.DataFrame(dict(zip(["f", *_PLAIN], columns, strict=True)))
    frame.to_excel(folder / "scan.xlsx", index=False)
    with zipfile.ZipFile(folder / "scan.zip", "w") as archive:
        archive.write(folder / "scan.xlsx", "measured/scan.xlsx")
    return [folder / "scan.zip"]


def parquet_of_levels(sweep: Sweep, folder: Path) -> list[Path]:
    """A DataFrame of two levels, as pandas writes it to Parquet."""
    import pandas

    frequency, matrix, _ = first_point(sweep)
    names = [("f", ""), *((f"Y{e}", part) for e in NAMES for part in ("re", "im"))]
    columns = [frequency, *parts(matrix)]
    frame = pandas.DataFrame(dict(zip(names, columns, strict=True)))
    frame.to_parquet(folder / "scan.parquet")
    return [folder / "scan.parquet"]


def mat_of_frd(sweep: Sweep, folder: Path) -> list[Path]:
    """What `[Y, w] = frdata(sys)` leaves, in a structure."""
    frequency, matrix, _ = first_point(sweep)
    held = {"Y": np.moveaxis(matrix, 0, -1), "w": 2 * np.pi * frequency, "FrequencyUnit": "rad/s"}
    savemat(folder / "frd.mat", {"G": held})
    return [folder / "frd.mat"]


def in_encoding(encoding: str, end: str = "\n") -> Callable:
    """The plain table in another encoding, with other ends of lines."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        (path,) = plain(sweep, folder)
        path.write_bytes(path.read_text().replace("\n", end).encode(encoding))
        return [path]

    return write


def xz_of_mat(sweep: Sweep, folder: Path) -> list[Path]:
    (path,) = mat_of_frd(sweep, folder)
    return written(folder, "frd.mat.xz", lzma.compress(path.read_bytes()))


MORE_SWEEPS = (
    Foreign("p and q in names of files", named_files("scan_p{p:g}_q{q:g}.csv"), (*PU, *_D)),
    Foreign("p and q with blanks", named_files("run P={p:g} Q={q:g}.csv"), (*PU, *_D)),
    Foreign("p and q in the first line", headed("# P = 1 pu; Q = 0.3 pu"), (*PU, *_D)),
    Foreign(
        "kW and kvar in a first line", headed("# P = 10 kW, Q = 3 kvar"), (*PU, *BASE[:2], *_D)
    ),
    Foreign("German first line", headed("Wirkleistung: 1", "Blindleistung: 0.3"), (*PU, *_D)),
    Foreign(
        "several files, an --op each",
        named_files("{p:g}x{q:g}.txt"),
        (*PU, *_D, "--op", "full:p=1,q=0.3", "--op", "back:p=1,q=-0.3"),
    ),
    Foreign("v and i at rest in first lines", rest_beside, (*BASE, "--unit", "S", *_D)),
    Foreign("millisiemens", unit_of_columns("mS", 1e-3), (*BASE, *_D, *_POINT)),
    Foreign("microsiemens", unit_of_columns("µS", 1e-6), (*BASE, *_D, *_POINT)),
    Foreign(
        "German columns",
        columns_named(
            "Frequenz (Hz)",
            "Y{e} Realteil",
            "Y{e} Imaginärteil",
            "Wirkleistung",
            "Blindleistung",
            mark=";",
            comma=True,
            encoding="cp1252",
        ),
        (*PU, *_D),
    ),
    Foreign(
        "French columns of ours",
        columns_named(
            "Fréquence (Hz)",
            "Y{e} partie réelle",
            "Y{e} partie imaginaire",
            "Puissance active",
            "Puissance réactive",
            mark="\t",
            comma=True,
        ),
        (*PU, *_D),
    ),
    Foreign(
        "Spanish columns",
        columns_named(
            "Frecuencia [Hz]",
            "Y{e} parte real",
            "Y{e} parte imaginaria",
            "Potencia activa",
            "Potencia reactiva",
            mark=";",
            comma=True,
        ),
        (*PU, *_D),
    ),
    Foreign(
        "Chinese columns of ours",
        columns_named(
            "频率(Hz)", "Y{e}实部", "Y{e}虚部", "有功功率", "无功功率", encoding="gb2312"
        ),
        (*PU, *_D),
    ),
    Foreign("French module and phase", pairs("Module Y{e}", "Phase Y{e} (degrés)"), (*_SAID,)),
    Foreign("Chinese magnitude and phase", pairs("Y{e}幅值", "Y{e}相角(度)"), (*_SAID,)),
    Foreign("MATLAB's complex text", complex_cells("{re:.12g}{im:+.12g}i"), _SAID),
    Foreign("Python's complex text", complex_cells("({re:.12g}{im:+.12g}j)"), _SAID),
    Foreign("complex text with semicolons", complex_cells("{re:.12g}{im:+.12g}j", ";"), _SAID),
    Foreign("row and column by d and q", lettered_rows, (*_SAID, "--quantity", "Y")),
    Foreign("a workbook in an archive", zipped_book, _SAID),
    Foreign("Parquet of two levels", parquet_of_levels, _SAID),
    Foreign("what frdata leaves", mat_of_frd, _SAID),
    Foreign("a MAT file in xz", xz_of_mat, _SAID),
    Foreign("UTF-16", in_encoding("utf-16"), _SAID),
    Foreign("UTF-8 with its mark", in_encoding("utf-8-sig", "\r\n"), _SAID),
    Foreign("carriage returns alone", in_encoding("ascii", "\r"), _SAID),
    Foreign("a table in gz", packed(plain, "gz"), _SAID),
    Foreign("real() and imag()", cartesian("real(Y_{e})", "imag(Y_{e})"), _SAID),
    Foreign("G and B", cartesian("G{e}", "B{e}"), _SAID),
    Foreign(
        "tabs and decimal commas", cartesian("Y{e}.re", "Y{e}.im", mark="\t", comma=True), _SAID
    ),
)


def _saved(held: dict[str, object], kind: str, folder: Path) -> list[Path]:
    if kind == "mat":
        savemat(folder / "model.mat", held)
        return [folder / "model.mat"]
    if kind == "npz":
        np.savez(folder / "model.npz", **{name: np.asarray(one) for name, one in held.items()})
        return [folder / "model.npz"]
    plain_lists = {k: np.asarray(one).tolist() for k, one in held.items()}
    return written(folder, "model.json", json.dumps(plain_lists))


def model(kind: str, change: Callable[[dict[str, np.ndarray]], dict[str, object]]) -> Callable:
    """The series inductance as a program saves it."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        return _saved(change(dict(zip("ABCD", MODEL, strict=True))), kind, folder)

    return write


def linmod(one: dict[str, np.ndarray]) -> dict[str, object]:
    """The structure that linmod returns."""
    cells = {
        "StateName": ["m/L_d", "m/L_q"],
        "InputName": ["m/Vd", "m/Vq"],
        "OutputName": ["m/Id", "m/Iq"],
    }
    names = {name: np.array(texts, dtype=object)[:, None] for name, texts in cells.items()}
    held = {letter.lower(): value for letter, value in one.items()}
    return {"lin": {**held, **names, "Ts": 0.0}}


def of_cells(one: dict[str, np.ndarray]) -> dict[str, object]:
    """struct(ss): matrices in cells of one element, and E empty."""
    return {
        "sys": {**one, "E": np.zeros((0, 0)), "InputName": np.array(["vd", "vq"], dtype=object)}
    }


def wider(one: dict[str, np.ndarray]) -> dict[str, object]:
    """A model with a set point in front of the voltages, and power behind the currents."""
    b, c = np.column_stack([[3.0, 4.0], one["B"]]), np.vstack([one["C"], [[5.0, 6.0]]])
    names = {"input_names": np.array(["p_ref", "v_d", "v_q"])}
    names["output_names"] = np.array(["i_d", "i_q", "p"])
    return {"A": one["A"], "B": b, "C": c, "D": np.zeros((3, 3)), **names}


def descriptor(one: dict[str, np.ndarray]) -> dict[str, object]:
    """E dx/dt = A x + B u, as a simulator with inductances on the left writes it."""
    mass = np.array([[2.0, 0.5], [0.0, 4.0]])
    return {"A": mass @ one["A"], "B": mass @ one["B"], "C": one["C"], "D": one["D"], "E": mass}


def algebraic(one: dict[str, np.ndarray]) -> dict[str, object]:
    """A descriptor system with a row 0 = x_3 - x_1 - x_2, which has no derivative."""
    a = np.zeros((3, 3))
    a[:2, :2], a[2] = one["A"], [-1.0, -1.0, 1.0]
    b, c = np.vstack([one["B"], np.zeros((1, 2))]), np.column_stack([one["C"], np.zeros((2, 1))])
    return {"A": a, "B": b, "C": c, "D": one["D"], "E": np.diag([1.0, 1.0, 0.0])}


MORE_MODELS = (
    Foreign("linmod in a structure", model("mat", linmod), _SAID),
    Foreign("ss as a structure with an empty E", model("mat", of_cells), _SAID),
    Foreign("python-control in NPZ with more signals", model("npz", wider), _SAID),
    Foreign("a descriptor system", model("mat", descriptor), _SAID),
    Foreign("a descriptor system with an algebraic row", model("npz", algebraic), _SAID),
    Foreign("small letters in JSON", model("json", lambda one: {**one, "dt": 0.0}), _SAID),
)


def _swap(matrix: np.ndarray) -> np.ndarray:
    """The columns of a matrix exchanged."""
    return matrix[:, :, ::-1]


def half_a_row(sweep: Sweep, folder: Path) -> list[Path]:
    """A row in the middle that broke off."""
    (path,) = plain(sweep, folder)
    lines = path.read_text().splitlines()
    lines[12] = lines[12][:30]
    path.write_text("\n".join([*lines, ""]))
    return [path]


def truncated(name: str, make: Callable, keep: float) -> Callable:
    """The first part of a file."""

    def write(sweep: Sweep, folder: Path) -> list[Path]:
        (path,) = make(sweep, folder)
        content = path.read_bytes()
        return written(folder, name, content[: int(keep * len(content))])

    return write


def same_file_twice(sweep: Sweep, folder: Path) -> list[Path]:
    """Two operating points below each other, without a column that tells them apart."""
    first, other = sweep.points[0], sweep.points[1]
    frequency = np.concatenate([first.frequency, other.frequency])
    matrix = np.concatenate([first.admittance, other.admittance])
    return written(folder, "scan.csv", rows_of(["f", *_PLAIN], [frequency, *parts(matrix)]))


MORE_SPOILT = (
    (Foreign("columns exchanged", spoilt(_swap), _SAID), "probably exchanged"),
    (Foreign("a row that broke off", half_a_row, _SAID), "is it cut off"),
    (
        Foreign("half a MAT file", truncated("half.mat", mat_of_frd, 0.5), _SAID),
        "must be a MAT file",
    ),
    (
        Foreign("p and q of another device", plain, (*PU, *_D, "--p", "10", "--q", "3")),
        "does not say the unit of p",
    ),
    (
        Foreign(
            "a base in kVA taken as VA",
            plain,
            ("--unit", "S", "--base", "10,400", *PU[2:], *_D, *_POINT),
        ),
        "the base is probably 10 kVA",
    ),
    (
        Foreign("two points as one", same_file_twice, _SAID),
        "whether the 2 runs over the frequencies are operating points",
    ),
)
