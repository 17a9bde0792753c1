"""Matrices in nested lists of JSON and in stacks with further ports: read as the block that the
device has at its terminal, or asked for with one question.
"""

import json

import numpy as np
import pytest

import ibrid
from ibrid.measurement.importing.importing import import_files

SAID = {"unit": "pu", "f0_hz": 60, "current": "out", "q_axis": "leads", "voltage_axis": "d"}
FREQUENCY = [1.0, 3.0, 10.0, 40.0, 300.0]
ENTRIES = ("dd", "dq", "qd", "qq")


def of_ports(ports: int, seed: int = 0) -> np.ndarray:
    """(5, n, n) complex numbers."""
    numbers = np.random.default_rng(seed).normal(size=(2, len(FREQUENCY), ports, ports))
    return numbers[0] + 1j * numbers[1]


def cartesian(value):
    return {"real": value.real.tolist(), "imag": value.imag.tolist()}


def of_entries(matrix, form):
    return {name: form(matrix[:, k // 2, k % 2]) for k, name in enumerate(ENTRIES)}


def polar(value):
    return {"mag": abs(value).tolist(), "phase_deg": np.angle(value, deg=True).tolist()}


def pairs(value):
    return np.stack([value.real, value.imag], axis=-1).tolist()


def rows(matrix):
    return [{"freq_hz": f, "Y": cartesian(y)} for f, y in zip(FREQUENCY, matrix, strict=True)]


#: What stands in an operating point, and whether Y or Z must be said.
LAYOUTS = {
    "a matrix called dq": (lambda y: {"freq_hz": FREQUENCY, "dq": cartesian(y)}, True),
    "frequencies last": (
        lambda y: {"freq_hz": FREQUENCY, "Ydq": cartesian(np.moveaxis(y, 0, -1))},
        False,
    ),
    "pairs": (lambda y: {"freq_hz": FREQUENCY, "Y": pairs(y)}, False),
    "parts apart": (
        lambda y: {"freq_hz": FREQUENCY, "Y_re": y.real.tolist(), "Y_im": y.imag.tolist()},
        False,
    ),
    "entries": (lambda y: {"freq_hz": FREQUENCY, **of_entries(y, cartesian)}, True),
    "entries in dq": (lambda y: {"freq_hz": FREQUENCY, "dq": of_entries(y, cartesian)}, True),
    "magnitude and phase": (
        lambda y: {"freq_hz": FREQUENCY, "admittance": of_entries(y, polar)},
        False,
    ),
    "a wrapper": (lambda y: {"data": {"freq_hz": FREQUENCY, "Y": cartesian(y)}}, False),
    "a row at each frequency": (lambda y: {"points": rows(y)}, False),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_operating_points_in_a_list_are_read_from_nested_lists(tmp_path, layout):
    made, asks = LAYOUTS[layout]
    points = [
        {"name": name, "p": p, "q": 0.1, **made(of_ports(2, seed))}
        for seed, (name, p) in enumerate((("full", 1.0), ("half", 0.5)))
    ]
    path = tmp_path / "scan.json"
    path.write_text(json.dumps({"operating_points": points}))
    read = import_files([path], **SAID)
    if asks:
        assert [one.answers for one in read.questions] == [("--quantity Y", "--quantity Z")]
        read = import_files([path], **SAID, quantity="Y")
    first, second = read.answered().points
    for point, seed, p, name in ((first, 0, 1.0, "full"), (second, 1, 0.5, "half")):
        np.testing.assert_allclose(point.admittance, of_ports(2, seed), atol=1e-12)
        assert (point.op.name, point.op.p, point.op.q) == (name, p, 0.1)


def test_nested_lists_of_unlike_lengths_are_named(tmp_path):
    (tmp_path / "scan.json").write_text('{"freq_hz": [1, 2], "Y_re": [[[1, 2], [3]], [[4, 5]]]}')
    with pytest.raises(ibrid.IbridError, match=r"'Y_re' must hold numbers in lists of one length"):
        import_files([tmp_path / "scan.json"], **SAID)


def saved(folder, form, held):
    from scipy.io import savemat

    path = folder / f"scan.{form}"
    if form == "json":
        path.write_text(json.dumps({name: np.asarray(one).tolist() for name, one in held.items()}))
    else:
        {"npz": lambda: np.savez(path, **held), "mat": lambda: savemat(path, held)}[form]()
    return path


@pytest.mark.parametrize("form", ["npz", "mat", "json"])
@pytest.mark.parametrize("ports", [3, 4])
@pytest.mark.parametrize("letter", ["Y", "Z"])
def test_stacks_with_further_ports_leave_the_block_of_d_and_q(tmp_path, form, ports, letter):
    """With the other voltages constant: that of the admittance, or of the inverse of the whole
    impedance.
    """
    whole = of_ports(ports)
    matrix = whole if letter == "Y" else np.linalg.inv(whole)
    held = {"freq_hz": FREQUENCY, "p": 1.0, "q": 0.1}
    held |= {f"{letter}_re": matrix.real, f"{letter}_im": matrix.imag}
    read = import_files([saved(tmp_path, form, held)], **SAID)
    np.testing.assert_allclose(read.answered().points[0].admittance, whole[:, :2, :2], atol=1e-12)
    assert any(f"is {ports}x{ports} at each frequency" in one for one in read.remarks)
    assert any("what they answer is lost" in one for one in read.remarks)


def test_a_matrix_of_three_phases_that_are_alike_leaves_its_positive_sequence(tmp_path):
    """Law: with the turn a of 120 degrees it is Y_aa + a^2 Y_ab + a Y_ac."""
    own, left, right = of_ports(3)[:, 0].T
    matrix = np.array([[own, left, right], [right, own, left], [left, right, own]])
    beside = {"f_network": FREQUENCY, "p": 1.0, "q": 0.1}
    read = import_files([saved(tmp_path, "mat", {**beside, "Y": matrix})], **SAID)
    turn = np.exp(2j * np.pi / 3)
    positive = own + turn**2 * left + turn * right
    (tmp_path / "alone").mkdir()
    held = {**beside, "Y_pos_re": positive.real, "Y_pos_im": positive.imag}
    alone = import_files([saved(tmp_path / "alone", "mat", held)], **SAID).answered()
    entries = read.answered().points[0].admittance
    np.testing.assert_allclose(entries, alone.points[0].admittance, atol=1e-12)
    assert any("what the zero sequence answers is lost" in one for one in read.remarks)


def test_a_stack_whose_frequencies_cannot_be_told_from_its_ports_is_refused(tmp_path):
    held = {"freq_hz": FREQUENCY[:3], "Y": of_ports(3)[:3]}
    with pytest.raises(ibrid.IbridError, match="Y is 3x3 at each frequency; save the 2x2 block"):
        import_files([saved(tmp_path, "npz", held)], **SAID)
