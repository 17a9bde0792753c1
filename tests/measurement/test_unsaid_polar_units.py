"""Decibels that nobody calls so, radians that are called degrees, and entries that slipped by a
row, are asked for or named; tables that are what they say are not suspected.
"""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from sweep_makes import rows_of

import ibrid
from ibrid import cli
from ibrid.measurement import Sweep
from ibrid.measurement.quality.inspect import inspect
from ibrid.measurement.quality.shifted_entries import shifted_entries
from ibrid.measurement.sweeps.sweep import ENTRIES, OperatingPoint

DATA = Path(__file__).resolve().parents[2] / "data"
#: 16 ohm a unit: all impedances of the sweep are beyond 1 ohm, and their decibels above zero.
SAID = (
    *("--base", "10kVA,400V", "--f0-hz", "60", "--p", "1", "--q", "0.3"),
    *("--voltage-axis", "d", "--current", "out", "--q-axis", "leads"),
)
Z_BASE = 400.0**2 / 10e3


@pytest.fixture(scope="module")
def truth() -> Sweep:
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"])


def ohms(truth: Sweep) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and impedances of the first operating point, in ohm."""
    point = truth.points[0]
    return point.frequency, np.linalg.inv(point.admittance) * Z_BASE


def decibels_of_an_analyser(truth: Sweep, folder: Path, names: str) -> list[str]:
    """A file for each entry, with magnitudes in dB of ohm and degrees."""
    frequency, impedance = ohms(truth)
    files = []
    for entry, place in ENTRIES.items():
        value = impedance[(slice(None), *place)]
        assert (np.abs(value) > 1).all()
        columns = [frequency, 20 * np.log10(np.abs(value)), np.degrees(np.angle(value))]
        files.append(folder / f"scan_Z{entry}.csv")
        files[-1].write_text(rows_of(names.split(","), columns))
    return [str(path) for path in files]


def angles_in_radians(truth: Sweep, folder: Path) -> list[str]:
    """One table, whose names say degrees."""
    frequency, impedance = ohms(truth)
    values = [impedance[(slice(None), *place)] for place in ENTRIES.values()]
    columns = [part(value) for value in values for part in (np.abs, np.angle)]
    names = [part for entry in ENTRIES for part in (f"Z{entry} [ohm]", f"angle Z{entry} [deg]")]
    (folder / "scan.csv").write_text(rows_of(["f [Hz]", *names], [frequency, *columns]))
    return [str(folder / "scan.csv")]


def imported(files: list[str], out: Path, *options: str) -> int:
    return cli.main(["import", *files, *SAID, *options, "--out", str(out)])


def error_of(out: Path, truth: Sweep) -> float:
    true = truth.points[0].admittance
    return float(np.abs(ibrid.read_sweep(out).points[0].admittance - true).max())


def test_positive_numbers_that_may_be_decibels_are_asked_for(truth, tmp_path, capsys):
    files, out = decibels_of_an_analyser(truth, tmp_path, "f,Magnitude,Phase"), tmp_path / "out.csv"
    assert imported(files, out, "--unit", "ohm") == 2
    assert "--unit dBohm" in capsys.readouterr().err
    assert imported(files, out, "--unit", "dBohm") == 0
    assert error_of(out, truth) < 1e-9


def test_labels_of_an_analyser_before_magnitude_and_phase_are_understood(truth, tmp_path):
    names = "Frequency (Hz),Trace 1: Impedance: Magnitude (dBΩ),Trace 1: Impedance: Phase (°)"
    files, out = decibels_of_an_analyser(truth, tmp_path, names), tmp_path / "out.csv"
    assert imported(files, out) == 0
    assert error_of(out, truth) < 1e-9


def test_magnitudes_of_one_entry_are_mapped_once_for_all_its_files(truth, tmp_path):
    files, out = decibels_of_an_analyser(truth, tmp_path, "f,Trace1,Trace2"), tmp_path / "out.csv"
    assert imported(files, out, "--map", "Z=#2[dBohm]@#3[deg]") == 0
    assert error_of(out, truth) < 1e-9


def test_angles_below_a_turn_in_radians_are_asked_for_although_names_say_degrees(
    truth, tmp_path, capsys
):
    files, out = angles_in_radians(truth, tmp_path), tmp_path / "out.csv"
    assert imported(files, out) == 2
    assert "radians" in capsys.readouterr().err
    mapped = ",".join(f"Z{e}=#{2 * k + 2}[ohm]@#{2 * k + 3}[rad]" for k, e in enumerate(ENTRIES))
    assert imported(files, out, "--map", mapped) == 0
    assert error_of(out, truth) < 1e-9


def slipped(sweep: Sweep, entries: tuple[str, ...], rows: int) -> Sweep:
    """The sweep whose entries of the first operating point stand `rows` later than the others."""
    point = sweep.points[0]
    values = np.array(point.admittance)
    for entry in entries:
        place = (slice(None), *ENTRIES[entry])
        values[place] = np.roll(values[place], rows)
    return replace(sweep, points=(replace(point, admittance=values),))


def test_entries_one_row_late_or_early_are_named():
    wrong = []
    groups = [("dd",), ("qq",), ("dq",), ("qd", "qq"), ("dq", "qq")]
    names = ("paper_like", "gfm_droop", "published_feng_50kva")
    shipped = {name: path for name, path in ibrid.benchmarks().items() if name in names}
    for (name, path), entries, rows in product(shipped.items(), groups, (1, -1)):
        said = list(shifted_entries(slipped(ibrid.read_sweep(path), entries, rows)))
        side = "later" if rows > 0 else "earlier"
        if not (said and side in said[0] and all(f"Y{entry}" in said[0] for entry in entries)):
            wrong.append((name, entries, rows, said))
    assert wrong == []


def test_no_shipped_sweep_is_suspected_of_a_slip_and_inspect_says_those_that_are(truth):
    shipped = [*DATA.glob("*.csv"), *(DATA / "devices").glob("*.csv")]
    sweeps = {path.stem: ibrid.read_sweep(path) for path in sorted(shipped)}
    assert {name: said for name, one in sweeps.items() if (said := [*shifted_entries(one)])} == {}
    warnings = inspect(slipped(truth, ("qd", "qq"), 1)).warnings
    assert any("the row of iq" in sentence for sentence in warnings)


def many_rows(count: int = 60) -> Sweep:
    """A clean sweep at frequencies in steps of one ratio, where entries a row late are as smooth as
    those that are not.
    """
    return ibrid.sweep(
        "paper_like", [OperatingPoint("a", 0.6, 0.2, 1.0)], np.geomspace(1, 5000, count)
    )


@pytest.mark.parametrize("letter", ["Y", "Z"])
def test_rows_of_a_clean_sweep_that_are_late_are_named_by_import(tmp_path, capsys, letter):
    sweep, wrong = many_rows(), []
    for entry in ENTRIES:
        point = sweep.points[0]
        values = np.array(point.admittance if letter == "Y" else np.linalg.inv(point.admittance))
        place = (slice(None), *ENTRIES[entry])
        values[place] = np.concatenate([values[place][:1], values[place][:-1]])
        values = values if letter == "Y" else np.linalg.inv(values)
        late = replace(sweep, points=(replace(point, admittance=values),))
        ibrid.write_sweep(late, tmp_path / "late.csv")
        assert imported([str(tmp_path / "late.csv")], tmp_path / "out.csv", "--unit", "pu") == 0
        said = capsys.readouterr().err
        if f"{letter}{entry} probably stands one frequency later" not in said:
            wrong.append((entry, said))
    assert wrong == []
    assert list(shifted_entries(sweep)) == []


def test_rows_against_their_frequencies_and_angles_the_other_way_are_named():
    sweep = many_rows()
    point = sweep.points[0]
    for values in (point.admittance[::-1], np.conj(point.admittance)):
        wrong = replace(sweep, points=(replace(point, admittance=values),))
        assert "no stable device" in "".join(shifted_entries(wrong))


def test_directions_that_are_said_are_compared_with_the_highest_frequencies(
    truth, tmp_path, capsys
):
    point = truth.points[0]
    turned = {
        "q_axis": point.admittance.transpose(0, 2, 1),
        "current": -point.admittance,
    }
    said = {}
    for name, values in turned.items():
        columns = [
            part(values[(slice(None), *place)])
            for place in ENTRIES.values()
            for part in (np.real, np.imag)
        ]
        names = [f"Y{entry}_{part} [pu]" for entry in ENTRIES for part in ("re", "im")]
        (tmp_path / "turned.csv").write_text(
            rows_of(["f [Hz]", *names], [point.frequency, *columns])
        )
        assert imported([str(tmp_path / "turned.csv")], tmp_path / "out.csv") == 0
        said[name] = capsys.readouterr().err
    assert "q_axis: leads as said, while the highest frequencies show lags" in said["q_axis"]
    assert "current: out as said, while the highest frequencies show in" in said["current"]


def test_a_base_in_the_file_that_is_not_the_one_said_is_asked_for(truth, tmp_path, capsys):
    point = truth.points[0]
    columns = [
        part(point.admittance[(slice(None), *place)])
        for place in ENTRIES.values()
        for part in (np.real, np.imag)
    ]
    names = [f"Y{entry}_{part} [pu]" for entry in ENTRIES for part in ("re", "im")]
    text = rows_of(["f [Hz]", *names], [point.frequency, *columns])
    (tmp_path / "scan.csv").write_text(f"# Sbase = 100 MVA, Vbase = 0.4 kV\n{text}")
    assert imported([str(tmp_path / "scan.csv")], tmp_path / "out.csv") == 2
    assert "--unit pu:100MVA,400V" in capsys.readouterr().err
    assert (
        imported([str(tmp_path / "scan.csv")], tmp_path / "out.csv", "--unit", "pu:10kVA,400V") == 0
    )


def test_indices_and_voltages_beside_the_parts_of_an_entry_are_left_out(truth, tmp_path):
    """As electrochemical analysers write them."""
    frequency, impedance = ohms(truth)
    files = []
    for entry, place in ENTRIES.items():
        value = impedance[(slice(None), *place)]
        number = np.arange(1.0, len(frequency) + 1)
        columns = [number, frequency, np.abs(value), np.degrees(np.angle(value)), 0.3 * number]
        names = ["Number", "Frequency/Hz", "Impedance/Ohm", "Phase/deg", "Time/s"]
        files.append(tmp_path / f"cell_Z{entry}.txt")
        files[-1].write_text(rows_of(names, columns, "\t"))
    assert imported([str(path) for path in files], tmp_path / "out.csv") == 0
    assert error_of(tmp_path / "out.csv", truth) < 1e-9
