"""A bridge asks a device frequency by frequency, keeps every answer, and writes what it was
told.
"""

import numpy as np
import pytest

import ibrid
from ibrid.errors import SweepError
from ibrid.measurement.bridge import bridged
from ibrid.measurement.sweeps.sweep import OperatingPoint

FREQUENCY = (5.0, 50.0, 500.0)
POINTS = (OperatingPoint("a", 0.5, 0.1, 1.01), OperatingPoint("b", -0.2, 0.0))


def admittance(hz: float, point: OperatingPoint) -> np.ndarray:
    """Of R and L in the dq frame of 60 Hz, and a part that the power changes."""
    s = 2j * np.pi * hz
    impedance = np.array([[0.02 + s * 4e-4, -0.15], [0.15, 0.02 + s * 4e-4]])
    return -np.linalg.inv(impedance) + point.p * np.array([[0.1, 0], [0.3, 0.2]])


class Asked:
    """A device that counts its questions and is interrupted after so many."""

    def __init__(self, most: int = 100) -> None:
        self.questions: list[tuple[float, str, str]] = []
        self.most = most

    def __call__(self, hz: float, axis: str, point: OperatingPoint) -> np.ndarray:
        if len(self.questions) >= self.most:
            raise KeyboardInterrupt
        self.questions.append((hz, axis, point.name))
        return admittance(hz, point)[:, "dq".index(axis)]


def test_a_bridge_writes_the_admittance_that_the_device_has(tmp_path):
    sweep = bridged(
        Asked(), FREQUENCY, POINTS, tmp_path / "a.csv", f0_hz=60.0, power_node="pcc", s_base_va=1e4
    )
    again = ibrid.read_sweep(tmp_path / "a.csv")
    assert (again.names, again.power_node, again.s_base_va) == (("a", "b"), "pcc", 1e4)
    for point in POINTS:
        truth = np.array([admittance(hz, point) for hz in FREQUENCY])
        np.testing.assert_array_equal(sweep.point(point.name).admittance, truth)
        np.testing.assert_allclose(again.point(point.name).admittance, truth, rtol=1e-12)
        assert again.point(point.name).op == point
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


def test_a_measurement_that_was_stopped_goes_on_where_it_ended(tmp_path):
    first, then = Asked(most=5), Asked()
    with pytest.raises(KeyboardInterrupt):
        bridged(first, FREQUENCY, POINTS, tmp_path / "a.csv")
    with (tmp_path / "a.part").open("a") as kept:
        kept.write('{"op": "a", "hz": 50')  # the end of a line that a kill cut off
    sweep = bridged(then, FREQUENCY, POINTS, tmp_path / "a.csv")
    assert len(then.questions) == 12 - 5
    assert not set(then.questions) & set(first.questions)
    whole = bridged(Asked(), FREQUENCY, POINTS, tmp_path / "b.csv")
    for point in POINTS:
        np.testing.assert_array_equal(
            sweep.point(point.name).admittance, whole.point(point.name).admittance
        )


def test_answers_at_another_operating_point_are_not_mixed_in(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        bridged(Asked(most=5), FREQUENCY, POINTS, tmp_path / "a.csv")
    with pytest.raises(
        SweepError, match="answers at another operating point of the name a; remove it"
    ):
        bridged(Asked(), FREQUENCY, (OperatingPoint("a", 0.6, 0.1, 1.01),), tmp_path / "a.csv")


@pytest.mark.parametrize("answer", [[1.0], [1.0, np.nan], [[1.0, 2.0]]])
def test_an_answer_that_is_no_response_is_one_sentence(answer, tmp_path):
    with pytest.raises(SweepError, match="two finite numbers, the d and q current"):
        bridged(lambda hz, axis, point: answer, FREQUENCY, POINTS, tmp_path / "a.csv")
