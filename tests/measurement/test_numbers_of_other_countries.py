"""Numbers as other countries and programs write them: marks between thousands, polar cells,
decibels and percent are read one way in a whole table, or asked about.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid import cli
from ibrid.errors import SweepError
from ibrid.measurement.importing.cell_number import number
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.importing.numbers.decimal_mark import shown_mark
from ibrid.measurement.importing.numbers.number_format import NumberFormat
from ibrid.measurement.importing.table_files import read_tables
from ibrid.measurement.read_events import read_events

SAID = {
    "unit": "pu",
    "f0_hz": 50.0,
    "current": "out",
    "q_axis": "leads",
    "voltage_axis": "d",
    "p": 0.8,
    "q": 0.1,
}
FREQUENCY = np.array([5.0, 50.0, 999.0, 1000.0, 1500.0, 12000.0])
ENTRIES = ("dd", "dq", "qd", "qq")
MATRIX = np.array([[-1 + 0.25j, 0.125 - 0.5j], [0.0625, 1.5 - 2.375j]])[None] / (
    1 + FREQUENCY[:, None, None] / 100j
)


def english(value: float, decimals: int = 6) -> str:
    return f"{value:,.{decimals}f}"


def german(value: float, decimals: int = 6) -> str:
    return english(value, decimals).translate(str.maketrans(".,", ",."))


def entries(matrix: np.ndarray = MATRIX) -> dict[str, np.ndarray]:
    """Column -> numbers, real and imaginary parts."""
    flat = matrix.reshape(-1, 4)
    return {
        f"Y{entry}_{part}": getattr(flat[:, k], attribute)
        for k, entry in enumerate(ENTRIES)
        for part, attribute in (("re", "real"), ("im", "imag"))
    }


def table(
    path: Path,
    frequency: Callable[[float], str],
    entry: Callable[[float], str],
    separator: str = ";",
    above: str = "",
) -> Path:
    columns = {"f": [frequency(one) for one in FREQUENCY]}
    columns |= {name: [entry(one) for one in values] for name, values in entries().items()}
    rows = [separator.join(row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([*filter(None, [above]), separator.join(columns), *rows]))
    return path


def whole(value: float) -> str:
    return german(value, 0)


def whole_english(value: float) -> str:
    return english(value, 0)


def point(value: float) -> str:
    return f"{value:.6f}"


def quoted(value: float) -> str:
    return f'"{english(value, 0)}"'


#: How frequencies are written, how entries are, what parts them, and what is said of it.
MAKES = {
    "German": (whole, german, ";", "decimal mark: comma; the point parts thousands, 1.000"),
    "German with decimals": (lambda f: german(f, 2), german, ";", "decimal mark: comma; the point"),
    "German by blanks": (whole, german, " ", "decimal mark: comma; the point parts thousands"),
    "English": (
        whole_english,
        point,
        "\t",
        "decimal mark: point; the comma parts thousands, 1,000",
    ),
    "English by semicolons": (whole_english, english, ";", "decimal mark: point; the comma parts"),
    "English in quotes": (quoted, point, ",", "decimal mark: point; the comma parts thousands"),
    "points beside commas": (lambda f: f"{f:.1f}", german, ";", "decimal mark of Ydd_re, Ydd_im"),
    "commas beside points": (
        lambda f: f"{f:.1f}".replace(".", ","),
        point,
        ";",
        "decimal mark of f: comma",
    ),
    "three decimals": (
        lambda f: f"{f:.3f}".replace(".", ","),
        point,
        ";",
        "decimal mark of f: comma",
    ),
    "plain": (lambda f: f"{f:.3f}", point, ",", ""),
}


@each_of("make", MAKES)
def test_thousands_are_read_by_the_decimal_mark_of_the_table(tmp_path: Path, make: str):
    frequency, entry, separator, words = MAKES[make]
    path = table(tmp_path / "scan.csv", frequency, entry, separator)
    imported = import_files([path], **SAID)
    (read,) = imported.answered().points
    np.testing.assert_allclose(read.frequency, FREQUENCY)
    np.testing.assert_allclose(read.admittance, MATRIX, atol=1e-6)  # six decimals
    marks = [remark for remark in imported.remarks if "decimal mark" in remark]
    assert any(words in remark for remark in marks) if words else not marks


def test_powers_in_thousands_of_watts_are_those_of_a_table_with_decimal_commas(tmp_path: Path):
    path = table(tmp_path / "scan.csv", whole, german)
    lines = path.read_text().split("\n")
    rows = [f"8.000;1.000;{line}" for line in lines[1:]]
    path.write_text("\n".join([f"P [W];Q [var];{lines[0]}", *rows]))
    said = {key: value for key, value in SAID.items() if key not in "pq"}
    (read,) = import_files([path], **said, base="10kVA,400V").answered().points
    assert (read.op.p, read.op.q) == (0.8, 0.1)


@each_of("above", ["# P: 8.000 W, Q = 1.000 var", "# P: 8.000,0 W; Q = 1.000 var"])
def test_powers_above_a_table_have_its_decimal_mark(tmp_path: Path, above: str):
    path = table(tmp_path / "scan.csv", whole, german, above=above)
    said = {key: value for key, value in SAID.items() if key not in "pq"}
    (read,) = import_files([path], **said, base="10kVA,400V").answered().points
    assert (read.op.p, read.op.q) == (0.8, 0.1)


def test_numbers_with_two_readings_alone_are_asked_about_by_their_place(tmp_path: Path):
    path = tmp_path / "scan.csv"
    columns = ["f", *entries()]
    rows = [[f"{k}.250", *[f"{k + n}.125" for n in range(8)]] for k in (1, 2, 4)]
    path.write_text("\n".join(";".join(row) for row in [columns, *rows]))
    with pytest.raises(
        SweepError,
        match=r"line 2: f must show which mark is the decimal one; found '1.250', which is 1.250 "
        r"or 1250 .*, add --decimal point or --decimal comma",
    ):
        import_files([path], **SAID)
    for decimal, factor in (("point", 1.0), ("comma", 1000.0)):
        (read,) = import_files([path], **SAID, decimal=decimal).answered().points
        np.testing.assert_allclose(read.frequency, factor * np.array([1.25, 2.25, 4.25]))
    commas = path.read_text().replace(";", ",")  # a comma that parts cells is no decimal mark
    path.write_text(commas)
    assert import_files([path], **SAID).answered().points[0].frequency.tolist() == [
        1.25,
        2.25,
        4.25,
    ]


def test_numbers_with_two_readings_beside_columns_with_both_marks_are_asked_about(tmp_path: Path):
    path = table(tmp_path / "scan.csv", lambda f: f"{f:.1f}", german)
    lines = path.read_text().split("\n")
    path.write_text("\n".join([f"{lines[0]};P [W]", *(f"{line};8.000" for line in lines[1:])]))
    with pytest.raises(SweepError, match=r"P \[W\] .* \(other columns have points and commas\)"):
        import_files([path], **SAID)


def test_a_column_with_both_decimal_marks_is_refused_by_the_first_other_cell(tmp_path: Path):
    path = table(tmp_path / "scan.csv", whole, german)
    path.write_text(path.read_text().replace("\n50;", "\n50.5;").replace("\n999;", "\n999,5;"))
    with pytest.raises(
        SweepError,
        match=r"line 4: f must have the decimal mark of its column; found '50.5' and '999,5'",
    ):
        import_files([path], **SAID)


def test_the_command_takes_the_decimal_mark_and_says_what_it_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = table(tmp_path / "scan.csv", whole, german)
    options = [f"--{key.replace('_', '-')}={value}" for key, value in SAID.items()]
    assert cli.main(["import", str(path), *options, "--decimal", "comma", "--explain"]) == 0
    assert "decimal mark: comma; the point parts thousands, 1.000 (f) is 1000" in (
        capsys.readouterr().out
    )
    with pytest.raises(SweepError, match="decimal must be point or comma; found 'komma'"):
        import_files([path], **SAID, decimal="komma")


def test_records_in_volts_are_read_with_their_decimal_mark(tmp_path: Path):
    time = np.arange(80) / 1000
    wave = np.round(np.cos(2 * np.pi * 50 * time[:, None] - [0, 2.1, 4.2, 0.1, 2.2, 4.3]) * 1200)
    names = ["t [s]", *(f"{kind}{phase}" for kind in ("v", "i") for phase in "abc")]
    units = ["", *[" [V]"] * 3, *[" [A]"] * 3]
    head = ";".join(name + unit for name, unit in zip(names, units, strict=True))
    rows = [
        ";".join([f"{t:.4f}".replace(".", ","), *(german(value, 0) for value in values)])
        for t, values in zip(time, wave, strict=True)
    ]
    (tmp_path / "run.csv").write_text("\n".join([head, *rows]))
    (record,) = read_events(tmp_path / "run.csv", f0_hz=50.0, base="1MVA,1kV").records
    np.testing.assert_allclose(record.time, time, atol=1e-9)
    assert any("decimal mark: comma" in remark for remark in record.remarks)
    (said,) = read_events(
        tmp_path / "run.csv", f0_hz=50.0, base="1MVA,1kV", decimal="comma"
    ).records
    np.testing.assert_array_equal(said.v, record.v)


@each_of(
    "text",
    [
        "1.5",
        "0.125",
        "-.5",
        "1234.567",
        "1.2345",
        "5.",
        "1.234e3",
        "1,234.5",
        "1,234,567",
        "007.123",
    ],
)
def test_a_number_of_one_reading_shows_its_mark_and_its_mirror_the_other(text: str):
    mirrored = text.translate(str.maketrans(".,", ",."))
    digits = text.lstrip("-")
    assert shown_mark(digits) == "."
    assert shown_mark(mirrored.lstrip("-")) == ","
    assert number(text, False) == number(text, True) == number(mirrored, True)
    assert number(mirrored, False) is None
    assert number(text, False) == float(text.replace(",", ""))


def test_a_number_of_two_readings_and_one_of_none():
    assert [number("1.234", comma) for comma in (False, True)] == [1.234, 1234.0]
    assert [number("1,234", comma) for comma in (False, True)] == [1234.0, 1.234]
    assert number("0,5+1.234j", True) == 0.5 + 1234j
    for text in ("1.23.4", "12,34,5", "1.234,567,8", "1,2,3"):
        assert [number(text, comma) for comma in (False, True)] == [None, None]


@pytest.mark.slow
def test_numbers_of_a_workbook_are_no_text_and_text_shows_its_mark(tmp_path: Path):
    openpyxl = pytest.importorskip("openpyxl")

    def read(*cells: object, decimal: str = "") -> list[float]:
        book = openpyxl.Workbook()
        for k, cell in enumerate(["x", *cells]):
            book.worksheets[0].append([k or "f", cell, 0.5 if k else "b"])
        book.save(tmp_path / "scan.xlsx")
        (read,) = read_tables(tmp_path / "scan.xlsx", form=NumberFormat(decimal))
        return read.columns["x"].tolist()

    assert read(1.234, 2.5, 1000) == [1.234, 2.5, 1000]
    assert read("1,234.5", "1,000", 7) == [1234.5, 1000, 7]
    with pytest.raises(SweepError, match=r"cell B2 \(x\) must show which mark .* found '1,234'"):
        read("1,234", 7)
    assert read("1,234", 7, decimal="comma") == [1.234, 7]
    assert read("1,234", 7, decimal="point") == [1234, 7]


def test_text_of_a_dataframe_with_commas_of_two_readings_is_no_number():
    pandas = pytest.importorskip("pandas", reason="frames are made by pandas (pip install pandas)")
    frame = pandas.DataFrame({"f": ["5", "1,000"], **{name: [0.5, 1.0] for name in entries()}})
    with pytest.raises(SweepError, match=r"line 2: f must be a number; found '1,000'"):
        ibrid.read_sweep(frame, **SAID)


def polar_table(path: Path, cell: Callable[[complex], str], head: str = "Y{}") -> Path:
    names = ["f", *(head.format(entry) for entry in ENTRIES)]
    rows = [
        [f"{f:g}", *map(cell, values)]
        for f, values in zip(FREQUENCY, MATRIX.reshape(-1, 4).tolist(), strict=True)
    ]
    path.write_text("\n".join(";".join(row) for row in [names, *rows]), encoding="utf-8")
    return path


def degrees(value: complex) -> float:
    return float(np.angle(value, deg=True))


#: Polar cells, what must be said of their angles, and whether that is asked for.
POLAR = {
    "degrees": (lambda z: f"{abs(z):.8f}∠{degrees(z):.8f}", "", False),
    "degrees with a sign": (lambda z: f"{abs(z):.8f}∠{degrees(z):.8f}°", "", False),
    "degrees in words": (lambda z: f"{abs(z):.8f} < {degrees(z):.8f} deg", "", False),
    "radians in words": (lambda z: f"{abs(z):.8f}∠{np.angle(z):.8f} rad", "", False),
    "radians": (lambda z: f"{abs(z):.8f}∠{np.angle(z):.8f}", "rad", True),
    "radians with commas": (
        lambda z: f"{abs(z):.8f}∠{np.angle(z):.8f}".replace(".", ","),
        "rad",
        True,
    ),
    "radians of a positive turn": (
        lambda z: f"{abs(z):.8f}<{np.angle(z) % (2 * np.pi):.8f}",
        "rad",
        True,
    ),
}


@each_of("make", POLAR)
def test_angles_of_polar_cells_are_degrees_unless_they_may_be_radians(tmp_path: Path, make: str):
    cell, polar, asked = POLAR[make]
    path = polar_table(tmp_path / "scan.csv", cell)
    imported = import_files([path], **SAID)
    assert ("--polar deg or --polar rad" in imported.asked) == asked
    (read,) = import_files([path], **SAID, **({"polar": polar} if polar else {})).answered().points
    np.testing.assert_allclose(read.admittance, MATRIX, atol=1e-6)


def test_small_angles_are_degrees_where_that_is_said_and_zeros_ask_for_nothing(tmp_path: Path):
    path = polar_table(tmp_path / "scan.csv", lambda z: f"{abs(z):.8f}∠2.5")
    (read,) = import_files([path], **SAID, polar="deg").answered().points
    np.testing.assert_allclose(np.angle(read.admittance, deg=True), 2.5)
    path = polar_table(tmp_path / "real.csv", lambda z: f"{abs(z):.8f}∠0")
    assert read_tables(path)[0].polar_angle == 0


def test_degrees_said_to_be_radians_and_negative_magnitudes_are_refused(tmp_path: Path):
    path = polar_table(tmp_path / "scan.csv", POLAR["degrees"][0])
    with pytest.raises(SweepError, match=r"line 2: Ydd must have its angle in rad, as is said"):
        import_files([path], **SAID, polar="rad")
    path = polar_table(tmp_path / "scan.csv", lambda z: f"{20 * np.log10(abs(z))}∠{degrees(z)}")
    with pytest.raises(SweepError, match=r"line 3: Ydd must have a magnitude of zero or more"):
        import_files([path], **SAID)
    path = polar_table(tmp_path / "scan.csv", lambda z: f"{60 + abs(z)}∠{degrees(z)}")
    decibels = [f"Y{entry}=#{k}[dB]" for k, entry in enumerate(ENTRIES, 2)]
    with pytest.raises(SweepError, match=r"Ydd must not be in dB, in which no complex number is"):
        import_files([path], [",".join(decibels)], **SAID)


def test_polar_text_of_a_dataframe_is_asked_about_in_the_words_of_python():
    pandas = pytest.importorskip("pandas", reason="frames are made by pandas (pip install pandas)")
    cells = [[POLAR["radians"][0](value) for value in row] for row in MATRIX.reshape(-1, 4)]
    frame = pandas.DataFrame(cells, columns=[f"Y{entry}" for entry in ENTRIES])
    frame.insert(0, "f", FREQUENCY)
    with pytest.raises(SweepError, match='add polar="deg" or polar="rad"'):
        ibrid.read_sweep(frame, **SAID)
    (read,) = ibrid.read_sweep(frame, **SAID, polar="rad").points
    np.testing.assert_allclose(read.admittance, MATRIX, atol=1e-6)


def magnitudes(
    path: Path, matrix: np.ndarray, head: Callable[[str], str], *, decibel: bool, signed: str = ""
) -> Path:
    """A table of magnitudes and phases.

    signed : entries that are written as a negative magnitude, half a turn away.
    """
    columns = {"f": FREQUENCY}
    for k, entry in enumerate(ENTRIES):
        values = matrix.reshape(-1, 4)[:, k] * (-1 if entry in signed.split() else 1)
        size = 20 * np.log10(abs(values)) if decibel else abs(values)
        columns[head(entry)] = size * (-1 if entry in signed.split() else 1)
        columns[f"Y{entry}_phase_deg"] = np.angle(values, deg=True)
    rows = [[*columns], *np.stack([*columns.values()], axis=-1).tolist()]
    path.write_text("\n".join(",".join(map(str, row)) for row in rows))
    return path


DECIBELS = [",".join(f"Y{entry}=#{2 * k}[dB]@#{2 * k + 1}" for k, entry in enumerate(ENTRIES, 1))]


def unnamed(entry: str) -> str:
    return f"Y{entry}_mag"


@each_of("scale", [1e-3, 1.0, 10.0, 1e3, 1e5])
def test_decibels_are_decided_once_for_all_entries(tmp_path: Path, scale: float):
    """Of numbers in dB all entries, some or none go below zero."""
    matrix = MATRIX * scale
    path = magnitudes(tmp_path / "scan.csv", matrix, unnamed, decibel=True)
    below = (abs(matrix) < 1).any(axis=0)
    if below.all():
        imported = import_files([path], **SAID)
        assert "magnitudes taken as dB, as those of each entry go below zero" in imported.remarks
        (read,) = imported.answered().points
        np.testing.assert_allclose(read.admittance, matrix)
    elif below.any():
        with pytest.raises(SweepError, match=r"line \d: Y.._mag must be zero or more, .* \[dB\]"):
            import_files([path], **SAID)
    else:
        assert ("Ydd", "Ydd_mag at angle Ydd_phase_deg", "magnitude, degrees") in (
            import_files([path], **SAID).readings
        )
    (told,) = import_files([path], DECIBELS, **SAID).answered().points
    np.testing.assert_allclose(told.admittance, matrix)


@each_of("head", ["|Y{}|", "Y{}_mag [mS]"])
def test_negative_magnitudes_that_are_no_decibels_are_refused_by_their_place(
    tmp_path: Path, head: str
):
    path = magnitudes(tmp_path / "scan.csv", MATRIX, head.format, decibel=False, signed="qd")
    with pytest.raises(SweepError, match=r"line 2: .*Yqd.* must be zero or more.*half a turn"):
        import_files([path], **{**SAID, "unit": "S"}, base="10kVA,400V")


def test_magnitudes_of_which_some_say_decibels_are_refused(tmp_path: Path):
    def head(entry: str) -> str:
        return f"Y{entry}_mag [dB]" if entry == "dd" else f"Y{entry}_mag"

    path = magnitudes(tmp_path / "scan.csv", 1e5 * MATRIX, head, decibel=True)
    with pytest.raises(
        SweepError, match=r"found Ydd_mag \[dB\] in dB beside Ydq_mag, which says nothing"
    ):
        import_files([path], **SAID)


def test_tables_of_one_import_have_all_their_magnitudes_in_decibels_or_none(tmp_path: Path):
    files = [
        magnitudes(tmp_path / f"P{k}_Q0.csv", MATRIX * scale, unnamed, decibel=True)
        for k, scale in enumerate((1e-3, 1e5))
    ]
    said = {key: value for key, value in SAID.items() if key not in "pq"}
    with pytest.raises(SweepError, match=r"found some below zero in .*P0_Q0.csv, .*P1_Q0.csv"):
        import_files(files, **said)
    assert len(import_files(files, DECIBELS, **said).answered().points) == 2


def workbook(
    path: Path, columns: dict[str, list[float]], formats: dict[str, str], above: object = None
) -> Path:
    """A workbook from cell B3 on, with number formats of some columns.

    above : a number in percent behind the words `P [%]` in the first row.
    """
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    if above is not None:
        sheet["B1"], sheet["C1"] = "P [%]", above
        sheet["C1"].number_format = "0%"
    for column, (name, values) in enumerate(columns.items(), 2):
        sheet.cell(3, column, name)
        for row, value in enumerate(values, 4):
            cell = sheet.cell(row, column, value)
            cell.number_format = formats.get(name, "General")
    book.save(path)
    return path


def scan(**more: float) -> dict[str, list[float]]:
    columns = {
        name.replace("_percent", " [%]"): [value] * len(FREQUENCY) for name, value in more.items()
    }
    return {"f": FREQUENCY.tolist()} | columns | {k: v.tolist() for k, v in entries().items()}


WITHOUT_POWERS = {key: value for key, value in SAID.items() if key not in "pq"}


@pytest.mark.slow
@each_of("form", ["0%", "0.00%", "#,##0.0 %;[Red]-0.0 %", "General", '0.0"%"', r"0\%", "0.00E+00"])
def test_percent_of_a_format_and_percent_of_a_name_scale_once(tmp_path: Path, form: str):
    """A format scales what is shown unless its percent sign is a literal."""
    scales = form in ("0%", "0.00%", "#,##0.0 %;[Red]-0.0 %")
    stored = (0.8, 0.1) if scales else (80.0, 10.0)
    columns = scan(P_percent=stored[0], Q_percent=stored[1])
    path = workbook(tmp_path / "scan.xlsx", columns, {"P [%]": form, "Q [%]": form})
    imported = import_files([path], **WITHOUT_POWERS)
    assert imported.answered().points[0].op.pqv == pytest.approx((0.8, 0.1, 1.0))
    words = "P [%]: its cells are formatted in percent and read as they are shown, 0.8 as 80 %"
    assert (words in imported.remarks) == scales


@pytest.mark.slow
def test_percent_cells_without_percent_in_the_name_are_the_numbers_they_hold(tmp_path: Path):
    """Also where the map says %, and behind a name above the table."""
    path = workbook(tmp_path / "scan.xlsx", scan(P=0.8, Q=0.1), {"P": "0%", "Q": "0%"})
    for maps in ([], ["p=P[%]"], ["p=P[%],q=Q[%]"]):
        imported = import_files([path], maps, **WITHOUT_POWERS)
        assert imported.answered().points[0].op.pqv == pytest.approx((0.8, 0.1, 1.0))
        assert sum("formatted in percent" in one for one in imported.remarks) == str(maps).count(
            "%"
        )
    path = workbook(tmp_path / "scan.xlsx", scan(Q=0.1), {}, above=0.8)
    assert import_files([path], **WITHOUT_POWERS).answered().points[0].op.p == pytest.approx(0.8)


@pytest.mark.slow
def test_a_matrix_and_a_recording_in_percent_cells_are_scaled_once(tmp_path: Path):
    columns = {name.replace("Ydd_re", "Ydd_re [%]"): values for name, values in scan().items()}
    columns = {name.replace("Ydd_im", "Ydd_im [%]"): values for name, values in columns.items()}
    path = workbook(
        tmp_path / "scan.xlsx", columns, {name: "0.0%" for name in columns if "%" in name}
    )
    (table_read,) = read_tables(path)
    np.testing.assert_allclose(table_read.columns["Ydd_re [%]"], 100 * MATRIX[:, 0, 0].real)
    time = np.arange(0, 0.2, 0.005)
    record = {"t [s]": time.tolist()} | {
        name: (size + 0 * time).tolist() for name, size in (("v [%]", 1.0), ("p", 0.8), ("q", 0.1))
    }
    path = workbook(tmp_path / "run.xlsx", record, {"v [%]": "0%", "p": "0%", "q": "0%"})
    for channels in (None, "t=1,v=2[%],p=3[%],q=4[%]"):
        (read,) = read_events(path, f0_hz=50.0, unit="pu", channels=channels).records
        np.testing.assert_allclose(np.linalg.norm(read.v, axis=1), 1.0)
        np.testing.assert_allclose(np.linalg.norm(read.i, axis=1), np.hypot(0.8, 0.1))
