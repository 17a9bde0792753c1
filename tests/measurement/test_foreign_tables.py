"""Anybody's table: nearly forty makes of file become the same sweep with one command and at most
one --map.
"""

import re

import numpy as np
import pytest
from constant_current import constant_current_sweep
from foreign_files import MAKES
from scipy.io import savemat

import ibrid
from ibrid import cli
from ibrid.errors import SweepError
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.formats.touchstone import write_touchstone
from ibrid.measurement.importing import cell_number
from ibrid.measurement.importing.column_map import Source, parse_map
from ibrid.measurement.importing.foreign_table import array_table
from ibrid.measurement.importing.importing import import_files, import_tables
from ibrid.measurement.importing.table_files import read_tables


@pytest.mark.nightly
def test_makes_of_file_become_the_sweep_that_they_were_written_from(tmp_path, capsys):
    """The matrices agree to the digits that the file has, and names need no quotes."""
    truth = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    wrong = []
    for number, foreign in enumerate(MAKES):
        folder = tmp_path / str(number)
        folder.mkdir()
        files = [str(path) for path in foreign.write(truth, folder)]
        out = folder / "sweep.csv"
        status = cli.main(["import", *files, *foreign.options, "--out", str(out)])
        said = capsys.readouterr()
        if status:
            wrong.append((foreign.make, said.err, said.out))
            continue
        sweep = ibrid.read_sweep(out)
        for point, true in zip(sweep.points, truth.points, strict=False):
            same = point.admittance.shape == true.admittance.shape
            error = (
                np.abs(point.admittance - true.admittance).max() / np.abs(true.admittance).max()
                if same
                else np.inf
            )
            powers = np.abs(
                np.subtract([point.op.p, point.op.q, point.op.v], [true.op.p, true.op.q, true.op.v])
            ).max()
            if error > foreign.digits or powers > 1e-9 or "," in point.op.name:
                wrong.append((foreign.make, point.op.name, error, powers, said.err))
    assert wrong == []


TABLE = "f,p,q," + ",".join(
    f"Y{entry}_{part}" for entry in ("dd", "dq", "qd", "qq") for part in ("re", "im")
)
ROWS = "\n".join(f"{f},1,0.3,-1,0.1,0.3,0,0.3,0,1,0.1" for f in (1, 2, 4, 8))
SAID = ("--unit", "pu", "--f0-hz", "50", "--current", "out", "--q-axis", "leads")


def imported(tmp_path, text, *options):
    """The exit status of the command, and the folder's sweep."""
    (tmp_path / "table.csv").write_text(text)
    return cli.main(
        ["import", str(tmp_path / "table.csv"), *options, "--out", str(tmp_path / "sweep.csv")]
    )


def test_what_nobody_said_is_asked_for_at_once_with_the_options_to_add(tmp_path, capsys):
    assert imported(tmp_path, f"{TABLE}\n{ROWS}\n") == 2
    asked = capsys.readouterr().err
    wanted = (
        "--unit pu or --unit S --base",
        "--f0-hz 50 or --f0-hz 60",
        "--voltage-axis d or --voltage-axis q",
    )
    assert all(words in asked for words in wanted)
    assert not (tmp_path / "sweep.csv").exists()
    resistive = "\n".join(
        f"{f},1,0.3,1,0,0,0,0,0,1,0" for f in (100, 200, 400, 800)
    )  # neither law has anything to hold on to
    assert imported(tmp_path, f"{TABLE}\n{resistive}\n", "--unit", "pu", "--f0-hz", "50") == 2
    assert "--current out or --current in" in capsys.readouterr().err


def test_what_low_frequencies_show_is_taken_where_usual_and_else_asked_for(tmp_path, capsys):
    """Law: Y(0) = -[[p, -q], [-q, -p]] with the current out and q leading; here settled from 1 Hz
    on. q of the other sign is the same numbers as q behind d, and consumed power the same as a
    current into the inverter.
    """
    expected = {
        ("--p", "1", "--q", "0.3"): (
            0,
            "current: out, as the lowest frequencies show if p is what the inverter delivers",
        ),
        ("--p", "1", "--q", "-0.3"): (
            2,
            "behind d, or the sign of q is reversed): add --q-axis leads or --q-axis lags.",
        ),
        ("--p", "-1", "--q", "-0.3"): (
            2,
            "or p and q are what it consumes): add --current out or --current in.",
        ),
        ("--p", "1", "--q", "-0.3", "--q-axis", "leads"): (0, "or the sign of q is reversed"),
    }
    rows = "\n".join(f"{f},-1,0,0.3,0,0.3,0,1,0" for f in (1, 1.1, 1.2, 40))
    wrong = []
    for options, (status, words) in expected.items():
        axis = [] if "--q-axis" in options else ["--voltage-axis", "d"]
        said = ["--unit", "pu", "--f0-hz", "50", *axis, *options]
        answer = imported(tmp_path, f"{TABLE.replace(',p,q', '')}\n{rows}\n", *said)
        said = capsys.readouterr().err
        if answer != status or words not in said:
            wrong.append((options, answer, said))
    assert wrong == []


def test_signs_that_the_highest_frequencies_show_are_not_asked_for(tmp_path, capsys):
    """Law: an inductance is Z = L (s + omega_0 J) with the current into it and q leading; the signs
    of p and q do not matter.
    """
    frequency = np.geomspace(500, 5000, 12)
    impedance = 0.1 * (1j * frequency[:, None, None] / 50 * np.eye(2) + np.array([[0, -1], [1, 0]]))
    wrong = []
    for current, q_axis in (("out", "leads"), ("in", "leads"), ("out", "lags"), ("in", "lags")):
        mirror = np.diag([1, 1 if q_axis == "leads" else -1])
        matrix = (1 if current == "in" else -1) * mirror @ np.linalg.inv(impedance) @ mirror
        rows = "\n".join(
            ",".join(map(repr, [float(f), -1, -0.3, *m.ravel().view(float).tolist()]))
            for f, m in zip(frequency, matrix, strict=True)
        )
        told = ["--unit", "pu", "--f0-hz", "50"]
        assert imported(tmp_path, f"{TABLE}\n{rows}\n", *told) == 2
        assert "does not say on which axis the voltage at rest lies" in capsys.readouterr().err
        status = imported(tmp_path, f"{TABLE}\n{rows}\n", *told, "--voltage-axis", "d")
        said = capsys.readouterr().err
        if status or any(
            f"{words}, as the highest" not in said
            for words in (f"current: {current}", f"q_axis: {q_axis}")
        ):
            wrong.append((current, q_axis, said))
    assert wrong == []


def written_on_q(point, highest):
    """A table of a scan with axes qd0, voltage on q and current into the device, up to a frequency
    (Hz).
    """
    turned = -Convention(axes=-1).written(point.admittance)
    order = {"qq": (1, 1), "qd": (1, 0), "dq": (0, 1), "dd": (0, 0)}
    rows = [
        [
            f,
            *(
                part
                for place in order.values()
                for part in (matrix[place].real, matrix[place].imag)
            ),
        ]
        for f, matrix in zip(point.frequency, turned, strict=True)
        if f < highest
    ]
    names = ",".join(f"Y{entry}_{part}" for entry in order for part in ("re", "im"))
    return "\n".join(
        [f"fd0,{names}", *(",".join(f"{number:.9g}" for number in row) for row in rows)]
    )


def test_a_voltage_at_rest_on_q_is_seen_and_the_current_asked_for_where_it_is_not(tmp_path, capsys):
    """The column of the angle rests at J i0 while the other moves; high up an inductance shows the
    current.
    """
    point = constant_current_sweep(50.0, 50.0).points[0]
    said = ["--unit", "pu", "--f0-hz", "50", "--p", "0.9", "--q", "0.1"]
    assert imported(tmp_path, written_on_q(point, 300.0), *said) == 2
    assert "add --current out or --current in" in capsys.readouterr().err
    for highest, options in ((300.0, [*said, "--current", "in"]), (5e3, said)):
        assert imported(tmp_path, written_on_q(point, highest), *options) == 0
        assert "voltage_axis: q, as the lowest frequencies show" in capsys.readouterr().err
        read = ibrid.read_sweep(tmp_path / "sweep.csv").points[0].admittance
        np.testing.assert_allclose(read, point.admittance[: len(read)], atol=1e-7)


@pytest.mark.parametrize(
    "turn", [[[0, -1], [1, 0]], [[0, 1], [1, 0]]], ids=["90 degrees", "exchanged"]
)
def test_a_turned_frame_is_never_taken_silently_where_nobody_says_a_direction(tmp_path, turn):
    """High up an inductance shows current and side of q; from 20 Hz on nothing shows the axis."""
    sweep = constant_current_sweep(50.0, 50.0)
    point = sweep.points[0]
    turn = np.array(turn)
    for number, matrix in enumerate((point.admittance, turn @ point.admittance @ turn.T)):
        rows = [
            [f, *one.ravel().view(float)]
            for f, one in zip(point.frequency, matrix, strict=True)
            if f > 20
        ]
        names = ",".join(
            f"Y{entry}_{part}" for entry in ("dd", "dq", "qd", "qq") for part in ("re", "im")
        )
        path = tmp_path / f"{number}.csv"
        path.write_text(
            "\n".join([f"f_Hz,{names}", *(",".join(map(repr, map(float, row))) for row in rows)])
        )
        said = {"unit": "pu", "f0_hz": 50.0, "p": point.op.p, "q": point.op.q}
        assert "on which axis the voltage at rest lies" in import_files([path], **said).asked
        answered = (
            import_files([path], **said, voltage_axis="q" if number else "d").answered().points[0]
        )
        np.testing.assert_allclose(
            answered.admittance, point.admittance[-len(answered.frequency) :], atol=1e-9
        )


def test_names_with_q_first_ask_for_the_axis_where_the_data_show_none(tmp_path, capsys):
    """Law: Y(0) = -[[p, -q], [-q, -p]] turned by 90 degrees is its own opposite, where both columns
    rest.
    """
    rows = "\n".join(f"{f},1,0,0.3,0,0.3,0,-1,0" for f in (1, 1.1, 1.2, 40))
    said = ["--unit", "pu", "--f0-hz", "50", "--p", "1", "--q", "0.3"]
    assert (
        imported(
            tmp_path, f"f,Yqq_re,Yqq_im,Yqd_re,Yqd_im,Ydq_re,Ydq_im,Ydd_re,Ydd_im\n{rows}\n", *said
        )
        == 2
    )
    assert "add --voltage-axis d or --voltage-axis q" in capsys.readouterr().err


def test_files_of_known_makes_are_asked_for_what_neither_they_nor_their_make_say(tmp_path, capsys):
    """Touchstone with R 1 in S, Z-tool, and IMTB, whose numbers do not tell the signs."""
    numbers = (
        "1 0.1 0.2 0.1 0.1 0.1 0.1 0.2 0.1\n2 0.1 0.2 0.1 0.1 0.1 0.1 0.2 0.1\n4 0.1 0.2 0.1 0.1 "
        "0.1 0.1 0.2 0.1\n"
    )
    names = ",".join(
        f"Zdut_dq_{k}_{part}" for k in ("11", "12", "21", "22") for part in ("re", "im")
    )
    (tmp_path / "a.s2p").write_text(f"! p: 1\n! q: 0.2\n# Hz Y RI R 1\n{numbers}")
    (tmp_path / "b.s2p").write_text(f"# Hz Y RI R 50\n{numbers}")
    (tmp_path / "z.txt").write_text("f\tPCC-1_d\tPCC-1_q\n1 1j 2 3 4j\n2 1j 2 3 4j\n4 1j 2 3 4j\n")
    (tmp_path / "i.csv").write_text(f"f,{names}\n{numbers.replace(' ', ',')}")
    point, plain = ("--p", "1", "--q", "0.2"), ("--f0-hz", "50", "--base", "10kVA,400V")
    expected = {
        ("a.s2p", "--base", "10kVA,400V"): (
            "--unit pu or --unit S;",
            "--f0-hz 50 or --f0-hz 60",
        ),
        ("a.s2p", "--unit", "S", *plain): (
            "--current out or --current in",
            "--q-axis leads",
            "measured at the PCC",
        ),
        ("a.s2p", "--quantity", "Z"): ("--quantity Z is not what Y(1,1) says",),
        ("b.s2p",): ("the inverter's base", "--p 0.8 --q 0 (per unit) or --map p=COLUMN[kW]"),
        ("i.csv", *plain, *point): ("--current out or --current in.",),
        ("z.txt",): ("the inverter's base", "--f0-hz 50", "--p 0.8 --q 0"),
        ("z.txt", "--sequence-frequency", "dq"): (
            "--sequence-frequency dq says nothing of this matrix",
        ),
        ("z.txt", "b.s2p", *plain, *point): (
            "those of one operating point; found 2 tables",
            "or --op NAME if all",
        ),
        ("z.txt", "b.s2p", *plain, *point, "--op", "a"): (
            "one unit, one frame and one convention",
        ),
    }
    wrong = []
    for (file, *options), words in expected.items():
        others = [
            str(tmp_path / option) if option.endswith(".s2p") else option for option in options
        ]
        status = cli.main(
            ["import", str(tmp_path / file), *others, "--out", str(tmp_path / "sweep.csv")]
        )
        said = capsys.readouterr().err
        if status != 2 or ".meta," in said or any(word not in said for word in words):
            wrong.append((file, options, status, said))
    assert wrong == []
    assert (
        cli.main(
            [
                "import",
                str(tmp_path / "z.txt"),
                *plain,
                *point,
                "--out",
                str(tmp_path / "sweep.csv"),
            ]
        )
        == 0
    )
    assert "next: ibrid start" in capsys.readouterr().out
    truth = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    write_touchstone(truth, tmp_path / "own.y2p", truth.names[0])
    assert (
        cli.main(["import", str(tmp_path / "own.y2p"), "--out", str(tmp_path / "sweep.csv")]) == 0
    )
    sweep = ibrid.read_sweep(tmp_path / "sweep.csv")
    assert (sweep.f0_hz, sweep.power_node) == (truth.f0_hz, truth.power_node)
    np.testing.assert_allclose(sweep.points[0].admittance, truth.points[0].admittance, rtol=1e-12)


def test_what_is_assumed_or_left_out_is_said(tmp_path, capsys):
    """The voltage, rows of a positive sequence whose partner at f - 2 f0 was not scanned, and a
    row that stands twice.
    """
    volts = "\n".join([TABLE + ",Vpeak_V", *(f"{line},326" for line in ROWS.splitlines())])
    positive = "\n".join(["f,Zpos_re,Zpos_im", *(f"{f},0.1,{f / 100}" for f in range(60, 300, 10))])
    twice = "\n".join([TABLE, ROWS, ROWS.splitlines()[1]])
    scan = (*SAID[:-2], "--p", "1", "--q", "0.3")
    expected = {
        (volts, *SAID): (0, "v taken as 1, not from Vpeak_V (else --v)"),
        (positive, *scan): (
            0,
            "left out: 10 of 24 dq frequencies: each joins f0 + f and |f0 - f|, f0 = 50 Hz",
        ),
        (twice, *SAID): (0, "1 row left out, the same as one before: line 6"),
    }
    wrong = []
    for (text, *options), (status, words) in expected.items():
        answer, said = imported(tmp_path, text, *options), capsys.readouterr().err
        if answer != status or words not in said:
            wrong.append((answer, said))
    assert wrong == []


@pytest.mark.slow
def test_numbers_in_cells_above_a_table_are_its_steady_state(tmp_path, capsys):
    import openpyxl

    book = openpyxl.Workbook()
    above = [["P [kW]", 5], ["Q [kvar]", -1], ["U [V]", 404], []]
    rows = [
        list(map(float, line.split(",")[:1] + line.split(",")[3:])) for line in ROWS.splitlines()
    ]
    cells = [*above, TABLE.replace(",p,q", "").split(","), *rows]
    for row in cells:
        book.worksheets[0].append(row)
    book.save(tmp_path / "scan.xlsx")
    (tmp_path / "scan.csv").write_text("\n".join(";".join(map(str, row)) for row in cells))
    for name in ("scan.xlsx", "scan.csv"):
        options = [*SAID, "--base", "10kVA,400V", "--out", str(tmp_path / "sweep.csv")]
        assert cli.main(["import", str(tmp_path / name), *options]) == 0
        point = ibrid.read_sweep(tmp_path / "sweep.csv").points[0].op
        np.testing.assert_allclose((point.p, point.q, point.v), (0.5, -0.1, 1.01))


def workbook(path, changes, sheets=("Scan",)):
    """A workbook of the same table in each sheet, from cell C4 on below a title, with changed cells
    in the last.
    """
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.worksheets[0])
    rows = [TABLE.split(","), *(list(map(float, line.split(","))) for line in ROWS.splitlines())]
    for name in sheets:
        sheet = book.create_sheet(name)
        sheet["C1"], sheet["C2"] = "Scan of a Tuesday", "by hand"
        for k, row in enumerate(rows):
            for column, value in enumerate(row):
                sheet.cell(4 + k, 3 + column, value)
    for cell, value in changes.items():
        book.worksheets[-1][cell] = value
    book.save(path)
    return path


@pytest.mark.slow
def test_a_title_above_the_names_of_a_workbook_is_passed_over(tmp_path):
    pytest.importorskip("openpyxl")
    (table,) = read_tables(workbook(tmp_path / "scan.xlsx", {}))
    assert list(table.columns) == TABLE.split(",")
    assert table.line.tolist() == [5, 6, 7, 8]


@pytest.mark.slow
@pytest.mark.parametrize(("value", "row"), [("(0.0689)", 5), (True, 6), ("-6.889%", 6), ("abc", 8)])
def test_a_word_among_the_numbers_of_a_workbook_is_named_by_its_cell(tmp_path, value, row):
    pytest.importorskip("openpyxl")
    words = rf"scan.xlsx sheet Scan, cell F{row} \(Ydd_re\) must be a number; found '{re.escape(str(value))}'"
    with pytest.raises(SweepError, match=words):
        read_tables(workbook(tmp_path / "scan.xlsx", {f"F{row}": value}))


@pytest.mark.slow
def test_rows_with_an_error_in_a_workbook_are_left_out_by_name(tmp_path):
    pytest.importorskip("openpyxl")
    said = {"unit": "pu", "f0_hz": 50.0, "current": "out", "q_axis": "leads"}
    for changes in ({"G6": "#DIV/0!"}, {"G6": "=1+1"}, {"G6": None}):
        path = workbook(tmp_path / "scan.xlsx", changes)
        remarks = import_files([path], **said).remarks
        assert any(
            "left out: 1 rows with empty cells, first" in one
            and "sheet Scan, cell G6 (Ydd_im)" in one
            for one in remarks
        )
    two = workbook(tmp_path / "two.xlsx", {"G6": "#N/A"}, sheets=("P1_Q0", "P0.5_Q0"))
    assert any(
        "two.xlsx sheet P0.5_Q0 cell G6" in one for one in import_files([two], **said).remarks
    )


@pytest.mark.slow
def test_rows_that_a_workbook_hides_are_read_and_named(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    path = workbook(tmp_path / "scan.xlsx", {})
    book = openpyxl.load_workbook(path)
    for row in (6, 7):
        book["Scan"].row_dimensions[row].hidden = True
    book.save(path)
    (table,) = read_tables(path)
    assert table.line.tolist() == [5, 6, 7, 8]
    assert table.remarks == ("sheet Scan has hidden rows, which are read like the others: 6, 7",)


#: Rows from which a reading that is shifted by a column would differ.
APART = [f"{f},0.8,0.1,-1,0.1,0.3,0,0.3,0,1,{f / 100}" for f in (1, 2, 4, 8, 16)]


@pytest.mark.parametrize(
    "labels", [range(5), range(1, 6), ['"1"', '"2"', '"3"', '"4"', '"5"'], "abcde"]
)
@pytest.mark.parametrize("separator", [",", "\t", " "])
def test_names_above_numbered_rows_are_those_of_the_columns_behind(
    tmp_path, capsys, separator, labels
):
    """As write.table of R and to_csv(index_label=False) of pandas write them."""
    rows = [f"{label},{row}" for label, row in zip(labels, APART, strict=True)]
    text = "\n".join([TABLE, *rows]).replace(",", separator)
    assert imported(tmp_path, text, *SAID) == 0
    assert "first column has no name" in capsys.readouterr().err
    (point,) = ibrid.read_sweep(tmp_path / "sweep.csv").points
    assert point.op.pqv == (0.8, 0.1, 1.0)
    np.testing.assert_allclose(point.frequency, [1, 2, 4, 8, 16])
    np.testing.assert_allclose(point.admittance[:, 1, 1], 1 + 0.01j * point.frequency)


def test_names_of_rows_in_quotes_are_names_where_rows_were_left_out(tmp_path):
    """As write.table of R writes a part of a table."""
    rows = [
        f'"{label}" {row.replace(",", " ")}'
        for label, row in zip((1, 2, 5, 9, 10), APART, strict=True)
    ]
    assert imported(tmp_path, "\n".join([TABLE.replace(",", " "), *rows]), *SAID) == 0
    (point,) = ibrid.read_sweep(tmp_path / "sweep.csv").points
    assert point.op.pqv == (0.8, 0.1, 1.0)
    np.testing.assert_allclose(point.frequency, [1, 2, 4, 8, 16])


@pytest.mark.parametrize("factor", ["1.0e+03 *", "  1.0e-03  *", "1e3*", "10^3 ×", "1.0000e+06 x"])
@pytest.mark.parametrize("separator", [" ", ",", ";"])
def test_a_factor_above_the_numbers_is_not_passed_over(tmp_path, capsys, factor, separator):
    """As MATLAB displays a matrix whose entries are of different sizes."""
    text = "\n".join([TABLE, factor, "", *APART]).replace(",", separator)
    assert imported(tmp_path, text, *SAID) == 2
    assert "a factor of all numbers below it as MATLAB displays them" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["sweep_v2", "sweep_v1.1", "p0.8_v2_q0.1", "V3 of the scan"])
def test_a_version_in_the_name_of_a_file_is_no_voltage(tmp_path, name):
    path = tmp_path / f"{name}.csv"
    path.write_text("\n".join([TABLE, *APART]))
    assert import_files([path], **SPOKEN).answered().points[0].op.v == 1.0
    told = path.with_name("p0.8_q0.1_v0.95.csv")
    told.write_text(path.read_text())
    assert import_files([told], **SPOKEN).answered().points[0].op.v == pytest.approx(0.95)


def test_the_first_frequency_of_a_scan_is_not_the_nominal_one(tmp_path, capsys):
    said = [word for word in SAID if word not in ("--f0-hz", "50")]
    assert (
        imported(tmp_path, "\n".join(["# f1 = 10 Hz", "# f2 = 5000 Hz", TABLE, *APART]), *said) == 2
    )
    assert "the nominal frequency" in capsys.readouterr().err


#: A response as MATLAB keeps it, beside which its names and delays stand.
RESPONSE = {
    "ResponseData": np.ones((2, 2, 3)) * [1j, 2j, 3j],
    "Frequency": [1.0, 2.0, 3.0],
    "FrequencyUnit": "Hz",
}


@pytest.mark.parametrize(
    "beside",
    [{"InputName": ["vq", "vd"]}, {"OutputName": np.array(["i_Q [A]", "i_D [A]"], object)}],
)
def test_names_of_a_response_with_q_before_d_are_refused(tmp_path, beside):
    savemat(tmp_path / "scan.mat", {"G": RESPONSE | beside})
    with pytest.raises(
        SweepError,
        match=r"G\.(In|Out)putName must name d before q, .* found (vq, vd|i_Q \[A\], i_D)",
    ):
        import_files([tmp_path / "scan.mat"], **SPOKEN)


def test_delays_that_a_response_of_matlab_does_not_hold_are_refused(tmp_path):
    savemat(
        tmp_path / "scan.mat",
        {"G": RESPONSE | {"InputDelay": [0.0, 1e-3], "OutputDelay": [0.0, 0.0]}},
    )
    with pytest.raises(
        SweepError, match=r"G.InputDelay must be zero, .* found 0.001, save .*frdata"
    ):
        import_files([tmp_path / "scan.mat"], **SPOKEN)
    savemat(
        tmp_path / "scan.mat",
        {"G": RESPONSE | {"InputDelay": [0.0, 0.0], "InputName": ["v_load", "u"]}},
    )
    import_files([tmp_path / "scan.mat"], **SPOKEN)


@pytest.mark.parametrize("last", ["", "ok"])
def test_a_last_column_that_is_empty_or_text_needs_no_name(tmp_path, last):
    assert imported(tmp_path, "\n".join([TABLE, *(f"{row},{last}" for row in APART)]), *SAID) == 0
    assert ibrid.read_sweep(tmp_path / "sweep.csv").points[0].op.pqv == (0.8, 0.1, 1.0)


def test_a_name_that_is_missing_is_refused_where_nothing_says_which(tmp_path, capsys):
    assert imported(tmp_path, "\n".join([TABLE, *(f"{row},0.5" for row in APART)]), *SAID) == 2
    assert (
        "line 1 must name each column; found 11 names above rows of 12 cells"
        in capsys.readouterr().err
    )


def test_a_number_in_brackets_is_neither_positive_nor_negative():
    assert [cell_number.number(text, False) for text in ("(0.5)", "( 1,200.5 )", "(1e-3)")] == [
        None
    ] * 3
    assert [cell_number.number(text, False) for text in ("(-0.5)", "(1-2j)", "0.5")] == [
        -0.5,
        1 - 2j,
        0.5,
    ]


def test_a_unit_below_one_name_alone_is_that_of_its_column(tmp_path, capsys):
    rows = ROWS.replace("\n8,", "\n0.008,")
    assert (
        imported(tmp_path, f"{TABLE.replace('f,', 'freq,', 1)}\nkHz{',' * 10}\n{rows}\n", *SAID)
        == 0
    )
    assert ibrid.read_sweep(tmp_path / "sweep.csv").points[0].frequency.tolist() == [
        8,
        1000,
        2000,
        4000,
    ]


def test_a_column_of_truth_values_in_a_dataframe_is_no_column_of_numbers():
    pandas = pytest.importorskip("pandas", reason="frames are made by pandas (pip install pandas)")
    frame = pandas.DataFrame({"f": [1.0, 2.0], "Ydd": [True, False]})
    with pytest.raises(
        SweepError, match="column Ydd must hold numbers or text; found true and false"
    ):
        ibrid.read_sweep(frame)


def test_infinite_numbers_are_named_and_refused(tmp_path, capsys):
    assert (
        imported(tmp_path, f"{TABLE}\n{ROWS.replace('4,1,0.3,-1', '4,1,0.3,-1e999')}\n", *SAID) == 2
    )
    assert (
        "line 4: Ydd_re must be finite; found -inf (infinite, or too large for a number)"
        in capsys.readouterr().err
    )


def test_a_matrix_of_four_columns_is_no_positive_sequence(tmp_path):
    frequency, flat = np.array([1.0, 2.0, 4.0]), np.arange(1, 13).reshape(3, 4) * 1j
    table = array_table({"freq": frequency, "Y": flat}, "scan.npz", "scan")
    with pytest.raises(
        SweepError, match=r"is a matrix must have the shape \(K, 2, 2\) or \(2, 2, K\)"
    ):
        import_tables([table])
    said = {
        "unit": "pu",
        "f0_hz": 50.0,
        "current": "out",
        "q_axis": "leads",
        "p": 0.0,
        "q": 0.0,
        "voltage_axis": "d",
    }
    named = import_tables([table], ["Ydd=Y:1,Ydq=Y:2,Yqd=Y:3,Yqq=Y:4"], **said).answered()
    np.testing.assert_array_equal(named.points[0].admittance, flat.reshape(3, 2, 2))


SPOKEN = {
    "unit": "pu",
    "f0_hz": 50.0,
    "current": "out",
    "q_axis": "leads",
    "p": 0.8,
    "q": 0.1,
    "voltage_axis": "d",
}


@pytest.mark.parametrize("count", [2, 3, 4, 8])
def test_few_frequencies_of_matlab_are_read_as_many(tmp_path, count):
    """A matrix has two rows and two columns, and four entries with two parts each."""
    frequency = np.geomspace(1.0, 100.0, count)
    matrices = np.arange(4 * count).reshape(count, 2, 2) * (1 + 0.5j)
    cells = np.empty((2, 2), dtype=object)
    for row, column in np.ndindex(2, 2):
        cells[row, column] = matrices[:, row, column]
    for form in (np.moveaxis(matrices, 0, -1), cells):
        savemat(tmp_path / "scan.mat", {"freq": frequency, "Y": form, "t": np.arange(9.0)})
        (point,) = import_files([tmp_path / "scan.mat"], **SPOKEN).answered().points
        np.testing.assert_array_equal(point.admittance, matrices)
        np.testing.assert_allclose(point.frequency, frequency)


def test_two_frequencies_of_which_nothing_says_where_they_are_counted_are_refused(tmp_path):
    np.savez(tmp_path / "scan.npz", freq=[1.0, 10.0], Y=np.arange(8.0).reshape(2, 2, 2) * 1j)
    with pytest.raises(
        SweepError,
        match=r"Y must say which of its indices counts the frequencies; found shape \(2, 2, 2\)",
    ):
        import_files([tmp_path / "scan.npz"], **SPOKEN)


@pytest.mark.parametrize(
    "arrays", [{"Y": np.ones((2, 2, 4))}, {"Y": np.ones((2, 2, 4)), "x": np.ones(3)}]
)
def test_matrices_without_frequencies_are_refused_by_what_is_there(arrays):
    with pytest.raises(SweepError, match=r"must have a column of frequencies; found (Y\(1,1\)|x)"):
        import_tables([array_table(arrays, "scan.mat", "scan")], **SPOKEN)


def test_a_unit_that_several_tables_lack_is_asked_for_once(tmp_path, capsys):
    files = []
    for power in (5000, 2500):
        files.append(str(tmp_path / f"{power}.csv"))
        table = f"# P: {power}\n# Q: 0\n{TABLE.replace(',p,q', '')}\n{ROWS.replace(',1,0.3', '')}\n"
        (tmp_path / f"{power}.csv").write_text(table)
    assert cli.main(["import", *files, *SAID, "--out", str(tmp_path / "sweep.csv")]) == 2
    assert capsys.readouterr().err.count("the unit of p") == 1


def test_the_positive_sequence_alone_is_read_with_a_word_on_what_it_cannot_tell(tmp_path, capsys):
    """Of an inductance, which couples nothing: Z = j omega L in the network is L (s + omega_0 J) in
    dq.
    """
    frequency = np.arange(10.0, 1000.0, 10.0)
    rows = "\n".join(
        f"{f:g},{0:g},{2 * np.pi * f * 0.1 / (2 * np.pi * 50):.15g}" for f in frequency
    )
    options = ("--p", "0.5", "--q", "0", "--unit", "pu", "--f0-hz", "50", "--current", "in")
    assert imported(tmp_path, f"Frequency (Hz),Zpos_re,Zpos_im\n{rows}\n", *options) == 0
    assert "cannot be told from these data" in capsys.readouterr().err
    (point,) = ibrid.read_sweep(tmp_path / "sweep.csv").points
    s = 2j * np.pi * point.frequency[:, None, None]
    expected = -np.linalg.inv(
        0.1 * (s / (2 * np.pi * 50) * np.eye(2) + np.array([[0, -1], [1, 0]]))
    )
    kept = (
        np.abs(point.frequency - 50) > 10
    )  # at f0 the network's frequency is zero, an ideal inductance a short circuit
    np.testing.assert_allclose(
        point.admittance[kept], expected[kept], rtol=0.05, atol=0.02
    )  # interpolated between 10 Hz


def test_a_table_that_cannot_be_understood_is_one_sentence(tmp_path, capsys):
    cases = {
        "no numbers here\n": "rows of numbers",
        f"{TABLE}\n{ROWS}\n8,1,0.3\n9,1,0.3,-1,0.1,0.3,0,0.3,0,1,0.1\n": "line 6",
        "a,b,c\n1,2,3\n2,3,4\n3,4,5\n": "column of frequencies",
        "f,b,c\n1,2,3\n2,3,4\n3,4,5\n": "--map Ydd=A+jB",
        f"{TABLE.replace('p,q', 'P [kW],q')}\n{ROWS}\n": "--base",
    }
    for text, expected in cases.items():
        assert imported(tmp_path, text, *SAID) == 2
        said = capsys.readouterr().err.splitlines()
        assert any(expected in line for line in said), (text, said)
    assert imported(tmp_path, f"{TABLE}\n{ROWS}\n", *SAID, "--map", "freq=ff") == 2
    assert "no such column" in capsys.readouterr().err


ALL = [
    "--base",
    "10kVA,400V",
    "--unit",
    "S",
    "--f0-hz",
    "50",
    "--current",
    "out",
    "--q-axis",
    "leads",
    "--p",
    "1",
    "--q",
    "0.3",
]
PAIRS = ",".join(
    f"Y{entry}=#{2 * k + 2}+j#{2 * k + 3}" for k, entry in enumerate(("dd", "dq", "qd", "qq"))
)
NUMBERS = "\n".join(f"{f},-1,0.1,0.3,0.2,0.3,0.1,1,0.1" for f in (1, 2, 4, 8))


def test_half_a_matrix_is_refused_with_the_columns_that_nobody_reads(tmp_path, capsys):
    parts = ",".join(
        f"Y{entry} {part}" for entry in ("dd", "dq", "qd", "qq") for part in ("jitsu", "kyo")
    )
    halves = ",".join(f"Y{entry}=#{2 * k + 2}" for k, entry in enumerate(("dd", "dq", "qd", "qq")))
    assert imported(tmp_path, f"f,{parts}\n{NUMBERS}\n", *ALL, "--map", halves) == 2
    said = capsys.readouterr().err
    assert "Ydd jitsu must be complex; found real numbers beside Ydd kyo" in said
    assert "--map Ydd=RE+jIM" in said
    half = ",".join(f"Z{entry} [dB],Z{entry} [x]" for entry in ("dd", "dq", "qd", "qq"))
    assert imported(tmp_path, f"f,{half}\n{NUMBERS}\n", *ALL) == 2
    assert capsys.readouterr().err
    assert imported(tmp_path, "f,Ydd,Ydq,Yqd,Yqq\n1,1,2,3,4\n2,1,2,3,4\n4,1,2,3,4\n", *ALL) == 2
    assert "Ydd must be complex; found real numbers, name both parts" in capsys.readouterr().err
    assert not (tmp_path / "sweep.csv").exists()


def test_groups_of_columns_are_refused_with_the_commands_that_read_them(tmp_path, capsys):
    """And these commands do read them."""
    for behind in ("", " P=1MW"):
        names = [
            f"Y{entry} {part}{op}"
            for op in ("", behind)
            for entry in ("dd", "dq", "qd", "qq")
            for part in ("Re", "Im")
        ]
        names = names if not behind else [f"{name} Q={k // 8}kvar" for k, name in enumerate(names)]
        rows = "\n".join(f"{line},{line.partition(',')[2]}" for line in NUMBERS.splitlines())
        assert imported(tmp_path, f"f,{','.join(names)}\n{rows}\n", *ALL) == 2
        assert "--op NAME --p P --q Q --out ONE.csv" in capsys.readouterr().err
    files = []
    for k in range(2):
        files.append(str(tmp_path / f"{k}.csv"))
        pairs = ",".join(
            f"Y{e}=#{8 * k + 2 * m + 2}+j#{8 * k + 2 * m + 3}"
            for m, e in enumerate(("dd", "dq", "qd", "qq"))
        )
        options = [
            *ALL[:-2],
            "--q",
            str(0.3 - 0.6 * k),
            "--op",
            f"op{k}",
            "--map",
            f"freq=#1,{pairs}",
        ]
        assert cli.main(["import", str(tmp_path / "table.csv"), *options, "--out", files[-1]]) == 0
    assert cli.main(["import", *files, "--out", str(tmp_path / "all.csv")]) == 0
    sweep = ibrid.read_sweep(tmp_path / "all.csv")
    assert [(point.op.name, point.op.q) for point in sweep.points] == [("op0", 0.3), ("op1", -0.3)]
    np.testing.assert_allclose(
        sweep.points[1].admittance[0],
        16 * np.array([[-1 + 0.1j, 0.3 + 0.2j], [0.3 + 0.1j, 1 + 0.1j]]),
    )


def test_entries_of_two_folders_are_two_points_and_one_that_comes_twice_is_refused(
    tmp_path, capsys
):
    files = []
    for folder in ("P1_Q0.3", "P1_Q-0.3"):
        (tmp_path / folder).mkdir()
        for entry in ("dd", "dq", "qd", "qq"):
            files.append(tmp_path / folder / f"Y{entry}.csv")
            files[-1].write_text("f,Re,Im\n1,1,2\n2,1,2\n4,1,2\n")
    options = [*ALL[:-4], "--out", str(tmp_path / "all.csv")]
    assert cli.main(["import", *map(str, files), *options]) == 0
    assert [point.op.q for point in ibrid.read_sweep(tmp_path / "all.csv").points] == [0.3, -0.3]
    again = tmp_path / "P1_Q0.3" / "_Ydd.csv"
    again.write_text(files[0].read_text())
    assert cli.main(["import", *map(str, files[:4]), str(again), *options]) == 2
    assert "must not hold Ydd_re again" in capsys.readouterr().err


def test_notes_beside_two_files_belong_to_each(tmp_path):
    for k, q in enumerate((0.3, -0.3)):
        (tmp_path / f"s{k}.csv").write_text(f"f,{','.join(f'c{n}' for n in range(8))}\n{NUMBERS}\n")
        (tmp_path / f"s{k}.csv.meta").write_text(f"p: 1\nq: {q}\n")
    files = [str(tmp_path / f"s{k}.csv") for k in range(2)]
    assert (
        cli.main(["import", *files, *ALL[:-4], "--map", PAIRS, "--out", str(tmp_path / "all.csv")])
        == 0
    )
    assert [point.op.q for point in ibrid.read_sweep(tmp_path / "all.csv").points] == [0.3, -0.3]


def test_two_letters_with_accents_beside_each_other_are_no_chinese_character(tmp_path, capsys):
    """Größe in CP1252 is GB2312 too, with a rare character in its middle; a name in Chinese has two
    or more in a row.
    """
    for said, encoding in (("Größe", "cp1252"), ("频率", "gb2312")):
        table = TABLE.replace("f,", f"f,{said},", 1) + "\n" + ROWS.replace(",1,0.3", ",7,1,0.3")
        (tmp_path / "table.csv").write_bytes(table.encode(encoding))
        assert (
            cli.main(
                ["import", str(tmp_path / "table.csv"), *SAID, "--out", str(tmp_path / "sweep.csv")]
            )
            == 0
        )
        assert said in capsys.readouterr().err


def test_two_columns_that_could_be_the_frequency_are_asked_for(tmp_path, capsys):
    """That of the network is f0 beside that of the dq frame: neither is taken unless it is said."""
    for first, second in (("f_network", "f_dq"), ("freq", "f_inj"), ("f_dq", "f_network")):
        rows = "\n".join(
            f"{f + 50},{row}" for f, row in zip((1, 2, 4, 8), ROWS.split(), strict=True)
        )
        table = f"{first},{TABLE.replace('f,', f'{second},', 1)}\n{rows}\n"
        assert imported(tmp_path, table, *SAID, "--p", "1", "--q", "0.3") == 2
        asked = capsys.readouterr().err
        assert f"--map freq={first} or --map freq={second}" in asked
        assert imported(tmp_path, table, *SAID, "--map", f"freq={second}") == 0
        np.testing.assert_allclose(
            ibrid.read_sweep(tmp_path / "sweep.csv").points[0].frequency, [1, 2, 4, 8]
        )
    alike = TABLE.replace("f,", "f,f_kHz,", 1)
    rows = "\n".join(
        f"{f},{f / 1e3},{row.partition(',')[2]}"
        for f, row in zip((1, 2, 4, 8), ROWS.split(), strict=True)
    )
    assert imported(tmp_path, f"{alike}\n{rows}\n", *SAID) == 0


def test_a_reference_is_no_measured_power_where_one_is_measured(tmp_path, capsys):
    for names in ("Pref,Qref,v0", "p0,q0,vref", "P_ref,Q_0,U0"):
        rows = "\n".join(f"9,9,9,{row},1" for row in ROWS.split())
        table = f"{names},{TABLE},v\n{rows}\n"
        assert imported(tmp_path, table, *SAID) == 0, capsys.readouterr().err
        point = ibrid.read_sweep(tmp_path / "sweep.csv").points[0].op
        assert (point.p, point.q, point.v) == (1, 0.3, 1)
    alone = TABLE.replace("p,q", "p0,q0")
    assert imported(tmp_path, f"{alone}\n{ROWS}\n", *SAID) == 0
    assert ibrid.read_sweep(tmp_path / "sweep.csv").points[0].op.p == 1


def test_the_map_names_columns_with_commas_and_a_unit_for_each_part():
    source = parse_map(
        ["Zpp=#2[dB]@#3[deg],freq=f, Hz[kHz],p=P[W]"], ("f, Hz", "a", "b"), {"P": (5.0, "kW")}
    )
    assert source["Zpp"] == Source(("a", "b"), "@", "dB", angle="deg")
    assert source["freq"] == Source(("f, Hz",), "", "kHz")
    assert source["p"] == Source((), "", "W", 5.0, name="P")


def test_what_is_shown_has_the_units_that_stand_there_and_files_are_counted(tmp_path, capsys):
    files = []
    for k in range(8):
        files.append(str(tmp_path / f"P{k}kW_Q1kvar.csv"))
        names = ",".join(
            f"Y{e} {part} [mS]" for e in ("dd", "dq", "qd", "qq") for part in ("Re", "Im")
        )
        (tmp_path / f"P{k}kW_Q1kvar.csv").write_text(f"f,{names}\n{NUMBERS}\n")
    assert cli.main(["import", *files, "--out", str(tmp_path / "all.csv")]) == 2
    said = capsys.readouterr()
    assert f"ibrid: {files[0]} and 7 more does not say the inverter's base" in said.err
    assert [line.split()[-1] for line in said.out.splitlines()[1:3]] == ["mS", "mS"]
    assert "kW" in said.out
    unknown = ",".join(f"Y{e}_{part}" for e in ("dd", "dq", "qd", "qq") for part in ("re", "im"))
    assert imported(tmp_path, f"f,{unknown}\n{NUMBERS}\n") == 2
    assert "unit unknown" in capsys.readouterr().out


def test_a_sweep_of_the_positive_sequence_alone_says_so_when_it_is_looked_at(tmp_path, capsys):
    rows = "\n".join(f"{f:g},0.05,{0.002 * f:.15g}" for f in np.arange(10.0, 1000.0, 10.0))
    options = ("--p", "0.5", "--q", "0", "--unit", "pu", "--f0-hz", "50", "--current", "in")
    assert imported(tmp_path, f"Frequency (Hz),Zpos_re,Zpos_im\n{rows}\n", *options) == 0
    sweep = ibrid.read_sweep(tmp_path / "sweep.csv")
    assert "matrix: positive sequence" in sweep.notes
    assert ibrid.inspect(sweep).warnings[0].startswith("the positive sequence alone was measured")


def test_rows_of_one_entry_that_nothing_tells_apart_are_refused(tmp_path, capsys):
    rows = [f"{f},{entry},1,2" for f in (1, 2, 4) for entry in ("dd", "dq", "qd", "qq")]
    assert (
        imported(tmp_path, "\n".join(["f,entry,re,im", *rows, *rows]), *ALL, "--quantity", "Y") == 2
    )
    assert "number repeats in a column repeat" in capsys.readouterr().err


def test_what_is_no_sweep_file_is_sent_to_import(tmp_path, capsys):
    (tmp_path / "run.scan").write_text("[Header]\n1,2\n")
    assert cli.main(["inspect", str(tmp_path / "run.scan")]) == 2
    assert "let ibrid import read it" in capsys.readouterr().err


def test_a_base_of_zero_and_words_that_are_no_choice_are_refused(tmp_path, capsys):
    assert imported(tmp_path, f"{TABLE}\n{ROWS}\n", "--unit", "S", "--base", "0,400") == 2
    assert "--base must be above zero" in capsys.readouterr().err
    for option in ("--voltage-axis", "--sequence-frequency"):
        assert imported(tmp_path, f"{TABLE}\n{ROWS}\n", option, "x") == 2
        assert "choose from" in capsys.readouterr().err
