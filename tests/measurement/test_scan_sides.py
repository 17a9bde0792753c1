"""Scans that stand below f0 of the network, or on both sides of zero in dq: one law brings them to
positive dq frequencies.
"""

from pathlib import Path

import numpy as np
import pytest

from ibrid.errors import SweepError
from ibrid.measurement.conventions.conversions import TO_SEQUENCE
from ibrid.measurement.importing.importing import Imported, import_files

F0 = 60.0
SAID = {"unit": "pu", "f0_hz": F0, "p": 0.7, "q": -0.2, "current": "out", "q_axis": "leads"}
ENTRIES = {"dq": ("dd", "dq", "qd", "qq"), "pn": ("pp", "pn", "np", "nn")}


def admittance(frequency: np.ndarray) -> np.ndarray:
    """A made-up device whose matrix has real coefficients in s, at frequencies of either sign."""
    s = 2j * np.pi * np.asarray(frequency, float)[:, None, None]
    loop = np.array([[0.4, 0.1], [-0.3, 0.2]]) / (1 + s / 40)
    return -np.linalg.inv(
        0.15 * (s / (2 * np.pi * F0) * np.eye(2) + np.array([[0, -1], [1, 0]]))
        + 0.3 * np.eye(2)
        + loop
    )


def sequences(frequency: np.ndarray) -> np.ndarray:
    return TO_SEQUENCE @ admittance(frequency) @ TO_SEQUENCE.conj().T


def imported(
    path: Path, name: str, frequency: np.ndarray, matrix: np.ndarray, frame: str, **said: object
) -> Imported:
    """The import of a table of these numbers."""
    names = [name, *(f"Y{entry}_{part}" for entry in ENTRIES[frame] for part in ("re", "im"))]
    rows = np.column_stack([frequency, matrix.reshape(-1, 4).view(float)])
    path.write_text(
        "\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())])
    )
    return import_files([path], **{**SAID, **said})


@pytest.mark.parametrize(
    ("network", "expected"),
    [
        (np.linspace(2, 58, 15), 15),
        (np.array([20.0, 33.0, 57.5, 61.0, 75.0, 140.0]), 6),
        (np.array([30.0, 45.0, 59.9, 60.1, 75.0, 90.0]), 3),
        (np.array([40.0, 60.0, 95.0, 400.0]), 3),
    ],
)
def test_rows_on_either_side_of_f0_are_the_matrix_at_their_dq_frequency(
    tmp_path, network, expected
):
    """Law: the row at g is Y_pn at g - f0, and Y_pn of a real device at -f is the conjugate at f
    with p and n exchanged.
    """
    answer = imported(tmp_path / "scan.csv", "f_network_Hz", network, sequences(network - F0), "pn")
    (point,) = answer.answered().points
    np.testing.assert_allclose(
        point.frequency, np.unique(np.round(np.abs(network - F0)[network != F0], 9)), rtol=1e-9
    )
    assert len(point.frequency) == expected
    np.testing.assert_allclose(point.admittance, admittance(point.frequency), rtol=1e-9, atol=1e-12)
    said = " ".join(answer.remarks)
    assert "below 60 Hz" in said
    assert ("at 60 Hz, which is no frequency" in said) == (F0 in network)


def test_negative_dq_frequencies_are_the_conjugate(tmp_path):
    frequency = np.array([-80.0, -10.0, 0.0, 10.0, 35.0])
    for frame, matrix in (("dq", admittance(frequency)), ("pn", sequences(frequency))):
        said = {"sequence_frequency": "dq"} if frame == "pn" else {}
        answer = imported(tmp_path / f"{frame}.csv", "f_Hz", frequency, matrix, frame, **said)
        (point,) = answer.answered().points
        np.testing.assert_allclose(point.frequency, [10, 35, 80])
        np.testing.assert_allclose(point.admittance, admittance(point.frequency), rtol=1e-9)
        assert any("left out: 1 row at zero frequency" in remark for remark in answer.remarks)


def test_sides_that_contradict_each_other_are_refused(tmp_path):
    """With f0 taken as 50 Hz the two sides of a 60-Hz scan show different matrices at one dq
    frequency.
    """
    network = np.arange(20.0, 200.0, 2.0)
    with pytest.raises(
        SweepError, match=r"must agree.*found them to differ by.*are f0 and the frame"
    ):
        imported(
            tmp_path / "scan.csv",
            "f_network_Hz",
            network,
            sequences(network - F0),
            "pn",
            f0_hz=50.0,
        )


def test_noise_of_a_percent_on_both_sides_is_no_contradiction(tmp_path):
    network = np.arange(20.0, 200.0, 2.0)
    noise = np.random.default_rng(1).standard_normal((2, len(network), 2, 2))
    matrix = sequences(network - F0) * (1 + 0.01 * (noise[0] + 1j * noise[1]))
    answer = imported(tmp_path / "scan.csv", "f_network_Hz", network, matrix, "pn")
    (point,) = answer.answered().points
    np.testing.assert_allclose(point.admittance, admittance(point.frequency), rtol=0.1, atol=0.05)


def test_the_noise_of_sequences_is_exchanged_too(tmp_path):
    """sigma of pp below f0 is that of nn; in a 2x2 of sequences alone the sum of both shows in dd,
    so the means over both sides fall by the root of two.
    """
    path = tmp_path / "scan.csv"
    names = ["f_network_Hz", *(f"Y{e}_{part}" for e in ENTRIES["pn"] for part in ("re", "im"))]
    names += [f"sigma_{entry}" for entry in ENTRIES["pn"]]
    sides = {50.0: [4, 3, 2, 1], 70.0: [1, 2, 3, 4], 90.0: [1, 2, 3, 4]}
    rows = [
        [g, *sequences(np.array([g - F0])).ravel().view(float), *(0.01 * np.array(sigma))]
        for g, sigma in sides.items()
    ]
    path.write_text("\n".join([",".join(names), *(",".join(map(str, row)) for row in rows)]))
    (point,) = import_files([path], **SAID).answered().points
    np.testing.assert_allclose(point.sigma[0] * np.sqrt(2), point.sigma[1], rtol=1e-9)


def test_the_positive_sequence_alone_has_the_dq_frequencies_of_both_sides(tmp_path):
    """Of an inductance, which couples nothing and whose interpolation is nearly exact; 119 Hz lacks
    its partner, 1 Hz.
    """
    network = np.array([5.0, 13.0, 48.0, 64.0, 100.0, 119.0, 240.0, 400.0])
    path = tmp_path / "scan.csv"
    path.write_text(
        "f,Zpos_re,Zpos_im\n" + "\n".join(f"{g!r},0.02,{g / F0 * 0.1!r}" for g in network.tolist())
    )
    (point,) = import_files([path], **{**SAID, "current": "in"}).answered().points
    np.testing.assert_allclose(point.frequency, [4, 12, 40, 47, 55, 180, 340])
    z = np.linalg.inv(-point.admittance)
    s = 1j * point.frequency[:, None, None] / F0
    expected = 0.02 * np.eye(2) + 0.1 * (s * np.eye(2) + np.array([[0, -1], [1, 0]]))
    np.testing.assert_allclose(z[:, 0, 0], expected[:, 0, 0], atol=2e-3)
