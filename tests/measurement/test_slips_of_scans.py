"""Decibels of power in place of those of amplitude, frequencies in krad/s as they are called, and a
turned frame with its current: each named or asked for with one question.
"""

import numpy as np
import pytest

import ibrid
from ibrid.measurement.importing.importing import import_files

ENTRIES = ("dd", "dq", "qd", "qq")
SAID = {"unit": "pu", "f0_hz": 60, "p": 1.0, "q": 0.3}
OUT = {"current": "out", "q_axis": "leads", "voltage_axis": "d"}


@pytest.fixture(scope="module")
def point():
    return ibrid.read_sweep(ibrid.benchmarks()["paper_like"]).points[0]


def scan(folder, names, columns):
    rows = [",".join(map(repr, row)) for row in np.stack(columns, axis=1).tolist()]
    path = folder / "scan.csv"
    path.write_text("\n".join([",".join(names), *rows]))
    return path


def cartesian(folder, frequency, matrix, name="f"):
    names = [name, *(f"Y{entry}_{part}" for entry in ENTRIES for part in ("re", "im"))]
    parts = np.stack([matrix.real, matrix.imag], axis=-1).reshape(-1, 8).T
    return scan(folder, names, [frequency, *parts])


@pytest.mark.parametrize("letter", ["Y", "Z"])
@pytest.mark.parametrize("size", [10, 20])
def test_decibels_with_10_log10_are_named_as_such(point, tmp_path, size, letter):
    """Law: with half of its decibels no entry is a rational function any more."""
    matrix = point.admittance if letter == "Y" else np.linalg.inv(point.admittance)
    entries = matrix.reshape(-1, 4).T
    columns = [point.frequency]
    for value in entries:
        columns += [size * np.log10(abs(value)), np.angle(value, deg=True)]
    names = ["f", *(f"{letter}{entry}_{part}" for entry in ENTRIES for part in ("dB", "deg"))]
    read = import_files([scan(tmp_path, names, columns)], **SAID, **OUT)
    named = [one for one in read.remarks if "probably 10 log10 of the magnitudes" in one]
    assert len(named) == (size == 10)


def test_angular_frequencies_are_shown_in_the_unit_that_they_have(point, tmp_path):
    omega = 2e-3 * np.pi * point.frequency
    path = cartesian(tmp_path, omega, point.admittance, "w [krad/s]")
    read = import_files([path], **SAID, **OUT)
    assert read.readings[0] == ("frequency", "w [krad/s]", "krad/s")
    np.testing.assert_allclose(read.answered().points[0].frequency, point.frequency)


def test_a_turned_frame_and_a_current_that_counts_in_are_one_question(tmp_path):
    """Law: the second column rests on q and p in the frame of the voltage, 30 degrees away."""
    frequency = np.geomspace(0.5, 60, 25)
    slow, low = (1 / (1 + 2j * np.pi * frequency / rate)[:, None, None] for rate in (6, 80))
    at_rest = low * np.array([[0, 0.3], [0, 0.8]]) + slow * np.array([[-2.0, 0], [0.4, 0]])
    matrix = at_rest - (1 - low) * np.array([[0.5, 0.1], [-0.1, 0.5]])
    cos, sin = np.cos(np.deg2rad(30)), np.sin(np.deg2rad(30))
    turn = np.array([[cos, -sin], [sin, cos]])
    path = cartesian(tmp_path, frequency, -turn @ matrix @ turn.T)
    said = {**SAID, "p": 0.8}
    (question,) = import_files([path], **said).questions
    ways = ("-30 --current in", "-30 --current out", "0")
    assert question.answers == tuple(f"--frame-deg {way}" for way in ways)
    assert "and which way the current counts" in question.sentence
    read = import_files([path], **said, frame_deg=-30, current="in").answered().points[0]
    np.testing.assert_allclose(read.admittance, matrix, atol=1e-9)
