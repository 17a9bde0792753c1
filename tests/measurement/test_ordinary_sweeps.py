"""Sweeps as spreadsheets, MATLAB, LTspice and scripts write them: each is read as what it says."""

import json
from pathlib import Path

import numpy as np
from collecting import collecting
from scipy.io import savemat

import ibrid
from ibrid.cli import main

POINT = ibrid.read_sweep(ibrid.benchmarks()["paper_like"]).points[0]
FREQUENCY = POINT.frequency
SIEMENS = POINT.admittance * 10e3 / 400**2
OHM = np.linalg.inv(SIEMENS)
ENTRIES = (("dd", 0, 0), ("dq", 0, 1), ("qd", 1, 0), ("qq", 1, 1))
PARTS = [f"{part}(Y{entry})" for entry, _, _ in ENTRIES for part in ("Re", "Im")]
UNIT_SAID = ("--unit", "S")


def parts(matrix: np.ndarray) -> list[float]:
    return [
        part for _, r, c in ENTRIES for part in (float(matrix[r, c].real), float(matrix[r, c].imag))
    ]


def rows() -> list[list[str]]:
    return [
        [f"{f:.7g}", *(f"{value:.7g}" for value in parts(matrix))]
        for f, matrix in zip(FREQUENCY.tolist(), SIEMENS, strict=True)
    ]


def text(*lines: str) -> str:
    return "\n".join(lines)


def table(separator: str = ",", body: list[list[str]] | None = None) -> str:
    head = separator.join(["f [Hz]", *(f"{part} [S]" for part in PARTS)])
    return text(head, *(separator.join(row) for row in body or rows()))


def in_decibels(unit: str) -> str:
    head = ["f [Hz]"]
    for entry, _, _ in ENTRIES:
        head += [f"|Z{entry}| [{unit}]", f"ang(Z{entry}) [deg]"]
    body = []
    for f, matrix in zip(FREQUENCY.tolist(), OHM, strict=True):
        row = [f"{f:.7g}"]
        for _, r, c in ENTRIES:
            row += [f"{20 * np.log10(abs(matrix[r, c])):.8g}"]
            row += [f"{np.angle(matrix[r, c], deg=True):.8g}"]
        body.append(",".join(row))
    return text(",".join(head), *body)


def of_spice(*, decibels: bool) -> str:
    lines = ["Freq.\t" + "\t".join(f"Y{entry}" for entry, _, _ in ENTRIES)]
    for f, matrix in zip(FREQUENCY.tolist(), SIEMENS, strict=True):
        cells = [f"{f:.15e}"]
        for _, r, c in ENTRIES:
            value = matrix[r, c]
            size, angle = 20 * np.log10(abs(value)), np.angle(value, deg=True)
            polar = f"({size:.15e}dB,{angle:.15e}°)"
            cells.append(polar if decibels else f"{value.real:.15e},{value.imag:.15e}")
        lines.append("\t".join(cells))
    return text(*lines)


def long_table(matrix: np.ndarray, letter: str, units: dict[str, str]) -> str:
    lines = ["f_hz,element,re,im,unit"]
    for f, values in zip(FREQUENCY.tolist(), matrix, strict=True):
        for entry, r, c in ENTRIES:
            value = values[r, c]
            lines.append(
                f"{f:.7g},{letter}{entry},{value.real:.8g},{value.imag:.8g},{units[entry]}"
            )
    return text(*lines)


def same_unit(unit: str) -> dict[str, str]:
    return dict.fromkeys(("dd", "dq", "qd", "qq"), unit)


def with_thousands(mark: str) -> str:
    body = [[f"{float(f):,.4f}".replace(",", mark), *others] for f, *others in rows()]
    return table(";", body)


#: Name of a file -> its text and the options that it needs.
TEXTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "quoted_commas.csv": (
        table(",", [[f'"{cell}"'.replace(".", ",") for cell in row] for row in rows()]),
        (),
    ),
    "units_below.csv": (
        text("," + ",".join(PARTS), "f [Hz]," + ",".join("S" * 8), *map(",".join, rows())),
        (),
    ),
    "parts_below.csv": (
        text(
            "Ydd,,Ydq,,Yqd,,Yqq,,",
            "Re,Im,Re,Im,Re,Im,Re,Im,f [Hz]",
            *(",".join([*others, f]) for f, *others in rows()),
        ),
        UNIT_SAID,
    ),
    "dbohm.csv": (in_decibels("dBOhm"), ()),
    "db_omega.csv": (in_decibels("dBΩ"), ()),
    "db_ohm.csv": (in_decibels("dB(ohm)"), ()),
    "spice_decibels.txt": (of_spice(decibels=True), UNIT_SAID),
    "spice_parts.txt": (of_spice(decibels=False), UNIT_SAID),
    "swiss.csv": (with_thousands("'"), ()),
    "swiss_typeset.csv": (with_thousands("’"), ()),
    "true_minus.csv": (table().replace("-", "−"), ()),
    "dash.csv": (table().replace("-", "–"), ()),
    "long_y.csv": (long_table(SIEMENS, "Y", same_unit("S")), ()),
    "long_z.csv": (long_table(OHM, "Z", same_unit("ohm")), ()),
    "pairs.json": (
        json.dumps(
            {"f": FREQUENCY.tolist()}
            | {
                f"Y{entry}": [[value.real, value.imag] for value in SIEMENS[:, r, c]]
                for entry, r, c in ENTRIES
            }
        ),
        UNIT_SAID,
    ),
    "objects.json": (
        json.dumps(
            {"f": FREQUENCY.tolist()}
            | {
                f"Y{entry}": [{"re": value.real, "im": value.imag} for value in SIEMENS[:, r, c]]
                for entry, r, c in ENTRIES
            }
        ),
        UNIT_SAID,
    ),
    "a_row_twice.csv": (table(",", [*rows()[:5], rows()[4], *rows()[5:]]), ()),
}


def imported(path: Path, options: tuple[str, ...]) -> np.ndarray:
    out = path.with_suffix(".imported.csv")
    words = ["import", str(path), "--base", "10kVA,400V", "--f0-hz", "60", "--voltage-axis", "d"]
    assert main([*words, "--op", "a:p=1,q=0.3", "--out", str(out), *options]) == 0
    return ibrid.read_sweep(out).points[0].admittance


def test_ordinary_tables_are_read_as_they_are(tmp_path, capsys):
    with collecting() as failures:
        for name, (content, options) in TEXTS.items():
            with failures.case(name):
                (tmp_path / name).write_text(content, encoding="utf-8")
                read = imported(tmp_path / name, options)
                np.testing.assert_allclose(read, POINT.admittance, atol=2e-5, rtol=1e-4)


def test_arrays_of_the_parts_of_a_matrix_are_read(tmp_path):
    whole = np.moveaxis(SIEMENS, 0, 2)
    degrees = np.angle(whole, deg=True)
    arrays = {
        "underscores": {"Y_re": whole.real, "Y_im": whole.imag},
        "words": {"Yreal": whole.real, "Yimag": whole.imag},
        "first": {"re_Y": whole.real, "im_Y": whole.imag},
        "polar": {"Y_mag": np.abs(whole), "Y_phase": degrees},
    }
    with collecting() as failures:
        for name, content in arrays.items():
            with failures.case(name):
                path = tmp_path / f"{name}.mat"
                savemat(path, {"f": FREQUENCY, **content})
                read = imported(path, UNIT_SAID)
                np.testing.assert_allclose(read, POINT.admittance, atol=1e-9)


def test_a_row_that_stands_twice_is_said(tmp_path, capsys):
    content, options = TEXTS["a_row_twice.csv"]
    (tmp_path / "twice.csv").write_text(content)
    imported(tmp_path / "twice.csv", options)
    assert "1 row left out, the same as one before: line 7" in capsys.readouterr().err


def test_entries_of_a_long_table_must_be_of_one_matrix_in_one_unit(tmp_path, capsys):
    mixed = long_table(SIEMENS, "Y", same_unit("S") | {"qq": "ohm"})
    both = long_table(SIEMENS, "Y", same_unit("S")).replace("Yqq", "Zqq")
    for content, said in ((mixed, "unit must be one unit"), (both, "entries of one matrix")):
        (tmp_path / "long.csv").write_text(content)
        assert main(["import", str(tmp_path / "long.csv"), "--out", str(tmp_path / "out.csv")]) == 2
        assert said in capsys.readouterr().err


def test_of_a_matrix_of_more_ports_without_names_it_is_said_what_is_taken(tmp_path, capsys):
    for ports in (3, 4):
        matrix = np.random.default_rng(ports).normal(size=(ports, ports, len(FREQUENCY))) + 0j
        savemat(tmp_path / "ports.mat", {"f": FREQUENCY, "Y": matrix})
        assert main(["import", str(tmp_path / "ports.mat"), "--out", str(tmp_path / "o.csv")]) == 2
        said = capsys.readouterr().err
        assert f"Y is {ports}x{ports} at each frequency" in said
        assert "if they stand in another order, save the 2x2 block of d and q" in said
