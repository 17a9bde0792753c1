"""A recorder that stood still is named; rest, steps of a simulation and coarse readings are not."""

from pathlib import Path

import numpy as np
import pytest
from recording_makes import F0, I_PEAK, V_PEAK, current, phases, text, times, voltage

import ibrid
from ibrid.measurement.recordings.standing_samples import STOOD, describe_standing

TIME = times()
V, I = voltage(TIME), current(TIME)
OF_PHASES = V_PEAK * phases(V, TIME), I_PEAK * phases(I, TIME)
OF_AXES = np.array([V.real, V.imag]), np.array([I.real, I.imag])
FIRST, COUNT = 1240, 90


def held(values: np.ndarray) -> np.ndarray:
    """The values, of which `COUNT` are that of `FIRST`."""
    standing = values.copy()
    standing[:, FIRST : FIRST + COUNT] = values[:, [FIRST]]
    return standing


def noisy(values: np.ndarray, seed: int) -> np.ndarray:
    return values + np.random.default_rng(seed).normal(0, 1e-3, values.shape)


def stepwise(values: np.ndarray, rows: int) -> np.ndarray:
    """The values of every so manyth row, held."""
    return values[:, np.arange(values.shape[1]) // rows * rows]


def rounded(values: np.ndarray, levels: int) -> np.ndarray:
    step = np.ptp(values) / levels
    return step * np.round(values / step)


def assert_stands(v: np.ndarray, i: np.ndarray, called: str) -> None:
    (said,) = describe_standing(TIME, v, i, F0)
    begin, end = TIME[FIRST], TIME[FIRST + COUNT - 1]
    assert said.startswith(f"{called} exactly the same from {begin:g} to {end:g} s (90 samples)")


def test_phases_that_stand_are_named():
    """All six, and the currents alone."""
    v, i = OF_PHASES
    assert_stands(held(v), held(i), "voltage and current stay")
    assert_stands(v, held(i), "current stays")
    assert_stands(rounded(held(v), 4096), rounded(held(i), 4096), "voltage and current stay")


def test_axes_that_stand_amid_noise_are_named():
    """d and q of which every other row moves."""
    v, i = noisy(OF_AXES[0], 1), noisy(OF_AXES[1], 2)
    assert_stands(held(v), held(i), "voltage and current stay")
    assert_stands(v, held(i), "current stays")


@pytest.mark.parametrize(
    ("v", "i"),
    [
        OF_PHASES,
        OF_AXES,
        tuple(noisy(one, 3) for one in OF_AXES),
        tuple(np.round(one, 3) for one in OF_AXES),
        *(tuple(stepwise(one, rows) for one in OF_PHASES) for rows in (5, 20, 50)),
        *(tuple(stepwise(one, rows) for one in OF_AXES) for rows in (5, 50)),
        *(tuple(rounded(one, levels) for one in OF_PHASES) for levels in (4, 16, 64, 256)),
        (OF_PHASES[0], np.where(TIME > 0.2, 0.0, OF_PHASES[1])),
        (OF_PHASES[0], np.zeros_like(OF_PHASES[1])),
    ],
)
def test_rest_steps_coarse_readings_and_a_trip_do_not_stand(v, i):
    """What is equal in neighbouring rows by its nature."""
    assert describe_standing(TIME, v, i, F0) == ()


def test_a_stand_is_said_on_reading_and_by_inspect(tmp_path: Path):
    """Once each."""
    v, i = (held(one) for one in OF_PHASES)
    names = [f"{letter}{phase} [{unit}]" for letter, unit in ("vV", "iA") for phase in "abc"]
    path = tmp_path / "rec.csv"
    path.write_text(text(["t", *names], [TIME, *v, *i]), encoding="utf-8")
    events = ibrid.read_events(path, base="10MVA,20kV", f0_hz=F0)
    assert sum(STOOD in remark for remark in events.records[0].remarks) == 1
    assert sum(STOOD in warning for warning in ibrid.inspect(events).warnings) == 1


def test_frames_at_rest_do_not_stand(tmp_path: Path):
    """Phasors of one value over many frames, with an event behind."""
    names = ["t", "v_mag [pu]", "v_ang [deg]", "i_mag [pu]", "i_ang [deg]"]
    columns = [part(one) for one in (V, I) for part in (abs, lambda x: np.angle(x, deg=True))]
    path = tmp_path / "frames.csv"
    path.write_text(text(names, [TIME, *columns]), encoding="utf-8")
    events = ibrid.read_events(path, window="none", base="10MVA,20kV", f0_hz=F0)
    assert not any(STOOD in remark for remark in events.records[0].remarks)
