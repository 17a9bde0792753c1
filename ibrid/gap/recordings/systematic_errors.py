"""Errors of a recorder that many samples share, and what a model makes of them: channels and
rounding.

A recorder's channel has an offset and a gain of its own. In the frame of the grid an offset turns
at -f0, and unequal gains leave of the conjugate a part that turns at -2 f0; at rest both show, so
that they tell how large such errors are. A gain common to all channels shows nowhere, and is as
wrong as they are unequal. A value that stands still is rounded alike at every sample, so that its
error stands still with it.

Each error is played: the voltage with it through the model, limits and all, less the voltage
without. A linear answer at rest does not do, since behind a limit no controller holds the current,
and a voltage that is wrong by 0.03 % moves it by 0.5 % of the rating.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ibrid.measurement.recordings.between_samples import standing
from ibrid.measurement.recordings.event_rest import waves_at_rest
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.playback.player import Player
from ibrid.playback.steps import ORDER_5

#: Current at rest, per unit, below which its waves do not tell how unequal the channels' gains are.
LEAST_CURRENT = 0.05
#: Errors of a voltage below this, per unit, are not played.
LEAST_ERROR = 1e-7
#: Runs of values that stand still whose rounding counts as one number, the longest of a record.
LONGEST = 8
#: Steps of a simulation times the fastest mode.
STEP = 1.0


@dataclass(frozen=True, eq=False)
class SystematicError:
    """One standard deviation of an error, d + j q, per unit: `v`, `i` (N,) of all samples,
    `v_rest`, `i_rest` of their means at rest.
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
    """(2 N, K) what each error leaves of the measured current, d and q of each sample in turn.

    Raises as `Player.play` does where the model has no rest; an error with which it has none leaves
    its current alone.
    """

    def played(record: EventRecord) -> np.ndarray:
        return player.play(record, [values], step=STEP, rule=ORDER_5)[0].current - record.i

    errors = list(errors)
    moving = [max(np.abs(one.v).max(), abs(one.i_rest)) > LEAST_ERROR for one in errors]
    exact = played(record) if any(moving) else np.zeros_like(record.i)
    columns = []
    for error, moves in zip(errors, moving, strict=True):
        left = played(_with(record, error)) - exact if moves else -_pairs(error.i)
        columns.append((left if np.isfinite(left).all() else -_pairs(error.i)).ravel())
    return np.array(columns).reshape(len(errors), record.i.size).T


def list_channel_errors(record: EventRecord, events: Events) -> Iterator[SystematicError]:
    """Offsets and gains of the channels of the recorder of some events.

    Their sizes are those at rest of all records together.
    """
    v, i = _complex(record.v), _complex(record.i)
    nothing, i_rest = np.zeros(len(v), dtype=complex), complex(*record.i_rest)
    of_v, of_i = (_at_rest(events, name) for name in ("v", "i"))
    turned = np.exp(-2j * np.pi * events.f0_hz * (record.time - record.time[0]))
    for direction in (1.0, 1.0j):
        yield SystematicError(of_v[0] * direction * turned, nothing)
        yield SystematicError(of_v[1] * direction * np.conj(v) * turned**2, nothing)
        yield SystematicError(nothing, of_i[0] * direction * turned)
        yield SystematicError(nothing, of_i[1] * direction * np.conj(i) * turned**2)
    yield SystematicError(of_v[1] * v, nothing, v_rest=of_v[1] * record.rest.v)
    yield SystematicError(nothing, of_i[1] * i, i_rest=of_i[1] * i_rest)


def _at_rest(events: Events, name: str) -> tuple[float, float]:
    """Offset, per unit, and relative difference of the gains of the channels of v or of i, rms of
    all records.
    """
    waves = np.array(
        [waves_at_rest(one, _complex(getattr(one, name)), events.f0_hz) for one in events.records]
    )
    sizes = np.maximum(waves[:, 0], LEAST_CURRENT)
    return float(np.sqrt(np.mean(waves[:, 1] ** 2))), float(
        np.sqrt(np.mean((waves[:, 2] / sizes) ** 2))
    )


def list_rounding_errors(record: EventRecord) -> Iterator[SystematicError]:
    """What rounding leaves of values that stand still."""
    nothing = np.zeros(len(record.time), dtype=complex)
    at_rest = record.time <= record.rest_end
    for of_v, step, wave in (
        (True, record.voltage_step, record.v),
        (False, record.current_step, record.i),
    ):
        for still in standing(wave)[:LONGEST] if step else ():
            rest = float((still & at_rest).sum() / at_rest.sum())
            for direction in (1.0, 1.0j):
                size = direction * step / np.sqrt(12.0)
                error = size * still
                yield (
                    SystematicError(error, nothing, v_rest=size * rest)
                    if of_v
                    else SystematicError(nothing, error, i_rest=size * rest)
                )


def _with(record: EventRecord, error: SystematicError) -> EventRecord:
    """The record as it would be read with an error: its rest and its frame are wrong with it."""
    v_rest, i_rest = record.rest.v + error.v_rest, complex(*record.i_rest) + error.i_rest
    turn = np.conj(v_rest) / abs(v_rest)
    power = v_rest * np.conj(i_rest)
    v, i = (
        turn * (_complex(wave) + part) for wave, part in ((record.v, error.v), (record.i, error.i))
    )
    rest = OperatingPoint(record.name, float(power.real), float(power.imag), float(abs(v_rest)))
    return replace(record, rest=rest, v=_pairs(v), i=_pairs(i))


def _complex(pairs: np.ndarray) -> np.ndarray:
    return pairs @ np.array([1.0, 1.0j])


def _pairs(wave: np.ndarray) -> np.ndarray:
    return np.stack([np.real(wave), np.imag(wave)], axis=1)
