"""Systematic errors of a recorder, and what a model makes of them in the current.

An error is systematic when many samples share it: the offset and the gain of a channel, and the
rounding of a value that stands still. In the dq frame of the grid an offset rotates at -f0, and
unequal gains of the phases turn the complex conjugate of the signal at -2 f0. Both are visible in
steady state, where their magnitudes are estimated. A gain that all channels have in common is not
visible; it is assumed to be as wrong as the gains are unequal.

The effect of an error is simulated: the voltage with it, limits included, minus the voltage
without. The linear response is not enough, since behind a limit no controller holds the current,
and a voltage that is wrong by 0.03 % moves the current by 0.5 % of the rating.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ibrid.measurement.recordings.between_samples import standing
from ibrid.measurement.recordings.dq_pairs import to_complex, to_pairs
from ibrid.measurement.recordings.event_rest import waves_at_rest
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.playback.player import Player
from ibrid.playback.steps import ORDER_5

#: Steady-state current, per unit, below which it does not show how unequal the gains are.
LEAST_CURRENT = 0.05
#: Errors of a voltage below this, per unit, are not simulated.
LEAST_ERROR = 1e-7
#: Longest intervals of constant value in a record whose rounding counts as an error of its own.
MOST_INTERVALS = 8
#: Time step of a simulation times the fastest mode.
STEP = 1.0


@dataclass(frozen=True, eq=False)
class SystematicError:
    """One standard deviation of an error of a recorded voltage or current, d + j q, per unit.

    Parameters
    ----------
    v, i : ndarray
        (N,) of every sample.
    v_rest, i_rest : complex
        Of the mean in steady state.
    """

    v: np.ndarray
    i: np.ndarray
    v_rest: complex = 0.0
    i_rest: complex = 0.0


def simulate_errors(
    player: Player,
    record: EventRecord,
    values: Mapping[str, float],
    errors: Iterable[SystematicError],
) -> np.ndarray:
    """Simulate how much each of K errors changes the residual of the current.

    Returns
    -------
    ndarray
        (2 N, K) per unit, d and q of each sample in turn. An error with which the model has no
        equilibrium changes the measured current only.

    Raises
    ------
    IbridError
        The model has no equilibrium (as `Player.play`).
    """

    def residual_of(record: EventRecord) -> np.ndarray:
        (response,) = player.play(record, [values], step=STEP, rule=ORDER_5)
        return response.current - record.i

    errors = list(errors)
    matters = [max(np.abs(error.v).max(), abs(error.i_rest)) > LEAST_ERROR for error in errors]
    exact = residual_of(record) if any(matters) else np.zeros_like(record.i)
    columns = []
    for error, is_simulated in zip(errors, matters, strict=True):
        change = -to_pairs(error.i)
        if is_simulated:
            simulated = residual_of(_add_error(record, error)) - exact
            change = simulated if np.isfinite(simulated).all() else change
        columns.append(change.ravel())
    return np.array(columns).reshape(len(errors), record.i.size).T


def list_channel_errors(record: EventRecord, events: Events) -> Iterator[SystematicError]:
    """Yield the errors by offset and gain of the channels, with the magnitudes of all records."""
    v = to_complex(record.v)
    i = to_complex(record.i)
    zero = np.zeros(len(v), dtype=complex)
    i_rest = complex(*record.i_rest)
    v_offset, v_gain = _estimate_channel_errors(events, "v")
    i_offset, i_gain = _estimate_channel_errors(events, "i")
    rotation = np.exp(-2j * np.pi * events.f0_hz * (record.time - record.time[0]))
    for direction in (1.0, 1.0j):
        yield SystematicError(v_offset * direction * rotation, zero)
        yield SystematicError(v_gain * direction * np.conj(v) * rotation**2, zero)
        yield SystematicError(zero, i_offset * direction * rotation)
        yield SystematicError(zero, i_gain * direction * np.conj(i) * rotation**2)
    yield SystematicError(v_gain * v, zero, v_rest=v_gain * record.rest.v)
    yield SystematicError(zero, i_gain * i, i_rest=i_gain * i_rest)


def _estimate_channel_errors(events: Events, name: str) -> tuple[float, float]:
    """Estimate offset (per unit) and relative difference of the gains of the channels "v" or "i".

    Root mean square over all records, from their steady state.
    """
    magnitudes = np.array(
        [
            waves_at_rest(record, to_complex(getattr(record, name)), events.f0_hz)
            for record in events.records
        ]
    )
    fundamental = np.maximum(magnitudes[:, 0], LEAST_CURRENT)
    offset = float(np.sqrt(np.mean(magnitudes[:, 1] ** 2)))
    gain_difference = float(np.sqrt(np.mean((magnitudes[:, 2] / fundamental) ** 2)))
    return offset, gain_difference


def list_rounding_errors(record: EventRecord) -> Iterator[SystematicError]:
    """Yield the rounding errors of values that stand still, d and q separately."""
    zero = np.zeros(len(record.time), dtype=complex)
    in_steady_state = record.time <= record.rest_end
    for name, step, wave in (
        ("v", record.voltage_step, record.v),
        ("i", record.current_step, record.i),
    ):
        if not step:
            continue
        for interval in standing(wave)[:MOST_INTERVALS]:
            share = float((interval & in_steady_state).sum() / in_steady_state.sum())
            for direction in (1.0, 1.0j):
                deviation = direction * step / np.sqrt(12.0)
                error = deviation * interval
                if name == "v":
                    yield SystematicError(error, zero, v_rest=deviation * share)
                else:
                    yield SystematicError(zero, error, i_rest=deviation * share)


def _add_error(record: EventRecord, error: SystematicError) -> EventRecord:
    """Return the record as it would be read with an error, steady state and dq frame included."""
    v_rest = record.rest.v + error.v_rest
    i_rest = complex(*record.i_rest) + error.i_rest
    rotation = np.conj(v_rest) / abs(v_rest)
    power = v_rest * np.conj(i_rest)
    v = rotation * (to_complex(record.v) + error.v)
    i = rotation * (to_complex(record.i) + error.i)
    rest = OperatingPoint(record.name, float(power.real), float(power.imag), float(abs(v_rest)))
    return replace(record, rest=rest, v=to_pairs(v), i=to_pairs(i))
