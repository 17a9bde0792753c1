"""A further pass of files that people of this trade have: each becomes what it was written from,
and what is no data, or is wrong on purpose, is named.
"""

import json

import numpy as np
import pytest
from more_recording_makes import MORE_RECORDINGS, MORE_WRONG
from more_sweep_makes import MORE_MODELS, MORE_SPOILT, MORE_SWEEPS
from recording_makes import P, Q, current, voltage
from sweep_makes import NAMES, first_point, model_response, parts, rows_of

import ibrid
from ibrid import cli
from ibrid.measurement.formats.model_poles import poles_of
from ibrid.measurement.recordings.events import EventRecord
from ibrid.schemas import breach

SAID = ["--unit", "pu", "--f0-hz", "60", "--current", "out", "--q-axis", "leads"]
SAID += ["--voltage-axis", "d", "--p", "1", "--q", "0.3"]


@pytest.fixture(scope="module")
def truth():
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"])


def imported(write, options, folder):
    """Exit status of an import of what `write` leaves in a folder."""
    folder.mkdir()
    files = [*map(str, write(folder))]
    return cli.main(["import", *files, *options, "--out", str(folder / "read.out.csv")])


def test_further_sweeps_and_models_are_what_they_were_written_from(truth, tmp_path, capsys):
    wrong = []
    for number, make in enumerate((*MORE_SWEEPS, *MORE_MODELS)):
        folder = tmp_path / str(number)
        if imported(lambda place, make=make: make.write(truth, place), make.options, folder):
            wrong.append((make.make, capsys.readouterr().err))
            continue
        point, true = ibrid.read_sweep(folder / "read.out.csv").points[0], truth.points[0]
        of_model = make in MORE_MODELS
        right = model_response(point.frequency) if of_model else true.admittance
        error = np.abs(point.admittance - right).max() / np.abs(right).max()
        powers = np.abs(np.subtract([point.op.p, point.op.q], [true.op.p, true.op.q])).max()
        if error > make.digits or powers > 1e-9:
            wrong.append((make.make, error, powers))
        if of_model and "a state space of order" not in capsys.readouterr().err:
            wrong.append((make.make, "says no order"))
    assert wrong == []


def test_further_recordings_are_what_they_were_written_from(tmp_path, capsys):
    wrong = []
    for number, made in enumerate(MORE_RECORDINGS):
        folder = tmp_path / str(number)
        if imported(made.write, made.options, folder):
            wrong.append((made.make, capsys.readouterr().err))
            continue
        (record,) = ibrid.read_events(folder / "read.out.csv").records
        rest = np.abs(np.subtract([record.rest.p, record.rest.q, record.rest.v], [P, Q, 1])).max()
        turn = np.exp(-1j * np.deg2rad(13))
        errors = [
            np.abs(getattr(record, name) @ [1, 1j] - law(record.time) * turn).max()
            for name, law in (("v", voltage), ("i", current))
        ]
        if max(rest, *errors) > made.digits:
            wrong.append((made.make, rest, errors))
    assert wrong == []


def test_further_files_that_are_wrong_on_purpose_are_caught(truth, tmp_path, capsys):
    silent = []
    sweeps = [
        (make.make, lambda place, make=make: make.write(truth, place), make.options, words)
        for make, words in MORE_SPOILT
    ]
    records = [(made.make, made.write, made.options, words) for made, words in MORE_WRONG]
    for number, (name, write, options, words) in enumerate((*sweeps, *records)):
        imported(write, options, tmp_path / str(number))
        if words not in (said := capsys.readouterr().err):
            silent.append((name, said))
    assert silent == []


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.png", b"\x89PNG\r\n\x1a\n\0", r"a picture \(PNG\)"),
        ("a.jpg", b"\xff\xd8\xff\xe0", r"a picture \(JPEG\)"),
        ("a.pdf", b"%PDF-1.7\n", r"a picture \(PDF\)"),
        ("a.svg", b'<?xml version="1.0"?>\n<svg xmlns="a">', r"a picture \(SVG\)"),
        ("a.fig", b"MATLAB 5.0 MAT-file", "a MATLAB figure"),
        ("a.docx", b"PK\3\4 word/document.xml", "a text document"),
        ("a.slx", b"PK\3\4 simulink/blockdiagram.xml", "a Simulink model"),
        ("a.csv", b"<!DOCTYPE html><html>", "a web page"),
    ],
)
def test_what_holds_no_numbers_is_called_what_it_is(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ibrid.IbridError, match=f"must hold numbers; found {words}.*"):
        ibrid.read_sweep(tmp_path / name)


def test_a_grid_in_series_is_taken_off_what_was_scanned(truth, tmp_path, capsys):
    """Law: the impedances of device and grid in series add, the current counted into the device."""
    frequency, matrix, _ = first_point(truth)
    line = (0.03 + 0.2j * frequency / 60)[:, None, None] * np.eye(2)
    series = np.linalg.inv(-matrix) + line + 0.2 * np.array([[0, -1], [1, 0]])
    names = ["f", *(f"Z{entry}_{part}" for entry in NAMES for part in ("re", "im"))]
    (tmp_path / "scan.csv").write_text(rows_of(names, [frequency, *parts(series)]))
    said = [one.replace("out", "in") for one in SAID]
    out = tmp_path / "device.csv"
    grid = ["--grid", "r=0.03,x=0.2", "--out", str(out)]
    assert cli.main(["import", str(tmp_path / "scan.csv"), *said, *grid]) == 0
    assert "the grid in series (r=0.03,x=0.2) is taken off" in capsys.readouterr().err
    read = ibrid.read_sweep(out).points[0].admittance
    np.testing.assert_allclose(read, matrix, atol=1e-9 * np.abs(matrix).max())


def test_a_state_space_is_compared_where_the_other_was_measured(truth, tmp_path, capsys):
    (path,) = MORE_MODELS[3].write(truth, tmp_path)
    (tmp_path / "model.mat.meta").write_text(
        "unit: pu\nf0_hz: 60\ncurrent: out\nq_axis: leads\nvoltage_axis: d\np: 1\nq: 0.3\n"
    )
    frequency = np.geomspace(7, 700, 23)
    response = model_response(frequency)
    sweep = ibrid.read_sweep((frequency, response), p=1, q=0.3, op="full", f0_hz=60)
    ibrid.write_sweep(sweep, tmp_path / "measured.csv")
    answer = tmp_path / "compared.json"
    measured = str(tmp_path / "measured.csv")
    assert cli.main(["compare", str(path), measured, "--json", str(answer)]) == 0
    assert "a state space of order 2, poles from 61.8" in capsys.readouterr().err
    compared = json.loads(answer.read_text())
    assert breach(compared, "compare-sweeps") is None
    assert compared["same"] is True
    assert compared["points"][0]["frequencies"] == 23
    assert cli.main(["compare", "gfl", measured]) == 2
    assert "compare the data with a record" in capsys.readouterr().err


def test_poles_of_a_descriptor_system_are_its_finite_ones():
    """x_1' = -3 x_1 + x_2, 0 = x_1 - x_2 has one pole at -2."""
    a, mass = np.array([[-3.0, 1.0], [1.0, -1.0]]), np.diag([1.0, 0.0])
    np.testing.assert_allclose(poles_of(a, mass, "here"), [-2.0], atol=1e-12)
    with pytest.raises(ibrid.IbridError, match=r"s E - A must be invertible"):
        poles_of(np.ones((2, 2)), np.ones((2, 2)), "here")


def test_a_voltage_that_may_be_of_two_kinds_is_asked_for(tmp_path):
    """0.9 of the base: between the phases in a weak grid, or a peak of a phase at 1.1."""
    rows = [f"{k / 1000:g},18000,8e6,1e6" for k in range(400)]
    for name, fails in (("U [V]", True), ("U [V_LL]", False)):
        (tmp_path / "a.csv").write_text("\n".join([f"t [s],{name},P [W],Q [var]", *rows]))
        if fails:
            with pytest.raises(ibrid.IbridError, match=r"line to line, rms at 0\.9 per unit"):
                ibrid.read_events(tmp_path / "a.csv", base="10MVA,20kV")
        else:
            (record,) = ibrid.read_events(tmp_path / "a.csv", base="10MVA,20kV").records
            assert record.rest.v == pytest.approx(0.9)


def test_entries_of_different_units_are_not_inverted_together(tmp_path):
    ports = ("d", "q", "dc")
    names = [
        f"Z{r}{c}_{part} [{'kohm' if r == c == 'dc' else 'ohm'}]"
        for r in ports
        for c in ports
        for part in ("re", "im")
    ]
    lines = [f"{f}," + ",".join(f"{k + f:g}" for k in range(18)) for f in (1.0, 2.0, 3.0)]
    (tmp_path / "a.csv").write_text("\n".join([",".join(["f", *names]), *lines]))
    with pytest.raises(ibrid.IbridError, match=r"must have one unit.*kohm, ohm"):
        ibrid.measurement.importing.importing.import_files([tmp_path / "a.csv"])


@pytest.mark.parametrize("factor", [10.0, 100.0, -1.0, 0.0])
def test_a_single_sample_that_stands_out_is_named_with_its_likely_slip(tmp_path, factor):
    time = np.arange(0, 0.3, 2e-4)
    values = np.stack([time, np.ones_like(time), 0 * time, np.full_like(time, 0.8), 0 * time - 0.1])
    values[3, 700] *= factor
    rows = [",".join(f"{cell:.9g}" for cell in row) for row in values.T]
    (tmp_path / "a.csv").write_text("\n".join(["t,v_d,v_q,i_d,i_q", *rows]))
    (record,) = ibrid.read_events(tmp_path / "a.csv", f0_hz=60).records
    slip = {-1.0: "sign is probably wrong", 0.0: "written as 0"}
    words = slip.get(factor, f"{factor:g} times too large")
    assert [one for one in record.remarks if "i_d stands out at 0.14 s" in one and words in one]


def test_a_step_of_the_voltage_and_its_current_do_not_stand_out(tmp_path):
    time = np.arange(0, 0.3, 2e-4)
    v = np.where(time > 0.1, 0.6, 1.0)
    i = 0.8 + 0.5 * np.where(time > 0.1, np.exp(-(time - 0.1) / 2e-4), 0.0)
    rows = [f"{t:.9g},{a:.9g},0,{b:.9g},0" for t, a, b in zip(time, v, i, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["t,v_d,v_q,i_d,i_q", *rows]))
    (record,) = ibrid.read_events(tmp_path / "a.csv", f0_hz=60).records
    assert not [one for one in record.remarks if "stands out" in one]


@pytest.mark.parametrize("values", [[["a", "b"]] * 4, np.ones((4, 2)) * 1j, [[1, 2], [3]]])
def test_a_record_of_what_is_no_number_is_refused_in_a_sentence(values):
    rest = ibrid.measurement.OperatingPoint("a", 0.8, 0.1)
    with pytest.raises(ibrid.IbridError, match="must be real numbers; found"):
        EventRecord(rest, np.arange(4.0), np.ones((4, 2)), values, 1.0)
