"""Errors that samples share, played through a model: against the model played with the true voltage
and with the recorded one.
"""

from dataclasses import replace

import numpy as np
import pytest

import ibrid
from ibrid.gap.recordings.systematic_errors import (
    SystematicError,
    list_channel_errors,
    list_rounding_errors,
    simulate_errors,
)
from ibrid.measurement.recordings.event_rest import record_from_rest
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.playback.limits import LIMITS
from ibrid.playback.player import Player
from ibrid.playback.recording import event_of

F0_HZ = 60.0
VALUES = {
    "plant.L_F": 0.15,
    "plant.R_F": 0.005,
    "plant.C_F": 0.066,
    "plant.L_g": 0.15,
    "plant.R_g": 0.01,
    "pll.kP_pll": 60.0,
    "pll.kI_pll": 1400.0,
    "power.kP": 0.02,
    "power.kI": 20.0,
    "current.kP": 0.5,
    "current.kI": 15.0,
    "decoupling.L": 0.15,
    "command_limit.u_max": 1.06,
}
LIMIT = next(one for one in LIMITS if one.id == "command_limit" and not one.windup)


def read(time: np.ndarray, v: np.ndarray, i: np.ndarray) -> EventRecord:
    return record_from_rest("swell", time, v, i, F0_HZ)


@pytest.fixture(scope="module")
def limited() -> tuple[Player, EventRecord]:
    """A swell that an inverter answers at the limit of its voltage, and its record."""
    time = np.arange(1500) / 5000.0
    v = event_of("swell:1.13,at=0.06,rise=0.002,for=0.1").voltage(time, 1.0)
    player = Player(ibrid.textbook("gfl_exact"), VOCABULARY, (LIMIT,))
    still = read(time, v, np.full(len(time), 0.6 - 0.1j))
    i = player.play(still, [VALUES])[0].current @ [1, 1j]
    return player, read(time, v, i)


def error_of(player: Player, record: EventRecord) -> np.ndarray:
    return (player.play(record, [VALUES])[0].current - record.i).ravel()


def test_a_channel_whose_gain_is_wrong_errs_through_a_limit_as_its_answer_says(limited) -> None:
    player, true = limited
    wrong, turn = 1e-3, np.array([1, 1j])
    v, i = true.v @ turn, true.i @ turn
    recorded = read(true.time, v * (1 + wrong), i)
    error = SystematicError(wrong * v, np.zeros(len(v), complex), v_rest=wrong * true.rest.v)
    (left,) = simulate_errors(player, true, VALUES, [error]).T
    measured = error_of(player, recorded) - error_of(player, true)
    assert np.linalg.norm(measured) > 5 * wrong * np.linalg.norm(
        true.i - true.i_rest
    )  # at rest it would be as wrong as the gain
    np.testing.assert_allclose(left, measured, atol=0.02 * np.abs(measured).max())


def test_a_value_that_stands_still_is_rounded_once(limited) -> None:
    """Rounded to 12 bits, the rest and the dip stand still: what that leaves is within what its
    errors say.
    """
    player, true = limited
    step = 4.0 / 2**12
    parts = [step * np.round(part / step) for part in true.v.T]
    rounded = replace(
        read(true.time, parts[0] + 1j * parts[1], true.i @ np.array([1, 1j])), voltage_step=step
    )
    errors = list(list_rounding_errors(rounded))
    assert 4 <= len(errors) <= 20
    columns = simulate_errors(player, rounded, VALUES, errors)
    left = error_of(player, rounded)
    directions, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    explained = directions[:, sizes > 1e-3 * sizes[0]]
    assert np.linalg.norm(left - explained @ (explained.T @ left)) < 0.3 * np.linalg.norm(left)


def test_a_clean_record_in_dq_has_no_such_errors(limited) -> None:
    _, true = limited
    assert not list(list_rounding_errors(true))
    channels = list_channel_errors(true, Events((true,), f0_hz=F0_HZ))
    assert max(np.abs(one.v).max() for one in channels) < 1e-7
