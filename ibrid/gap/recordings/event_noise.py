"""What records of events are judged by: the noise of the current, and what nobody measured of the
voltage between the samples.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ibrid.gap.recordings.systematic_errors import (
    list_channel_errors,
    list_rounding_errors,
    simulate_errors,
)
from ibrid.gap.refitting.noise import LEAST_UNKNOWN, Noise
from ibrid.measurement.estimators.correlation import correlated
from ibrid.measurement.recordings.between_samples import error_between, noise_left
from ibrid.measurement.recordings.event_rest import noise_at_rest, waves_at_rest
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.recordings.resampling import sampling_rate
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.playback.between_samples import (
    Matrices,
    RecordNoise,
    free_answers,
    noise_alone,
    noise_and_sampling,
    noise_of_frames,
    open_voltage,
)
from ibrid.playback.player import Player

#: Degrees of freedom of the estimate of what sampling leaves open: of drawn edges it is right to a
#: factor of two, rms.
SURE = 10.0
#: Size of an error of the voltage by which its pulse in the current is found, per unit.
BUMP = 1e-4
#: How far pulses are wrong, relative: of a model whose parameters are nominal or typical, and of
#: one that explains the records.
NOMINAL, FITTED = 0.3, 0.1
#: Samples per s that predictions are made of, at least, and descents far from the noise: both lead
#: to a valley.
PREDICTED_RATE, DECIMATED_RATE = 8e3, 5e3
#: Frequencies at which what a model passes of the voltage's noise is summed.
FREQUENCIES = 24
#: Part of the floor from which on that is said, and how.
SAID, SAMPLING = 0.3, ", and what sampling leaves open of the voltage"


@dataclass(frozen=True, eq=False)
class EventNoise(Noise):
    """The noise of event records.

    Parameters
    ----------
    events : Events
        The records.
    of : mapping
        Record -> its noise.
    noise_dof : float
        Degrees of freedom of the estimate of all noise (Welch and Satterthwaite).
    current_noise_dof : float
        Degrees of freedom of the estimate of the current's noise alone; infinite where it is
        declared, or below the floor that every model has.
    sampled : bool
        Much of the noise is the unknown voltage between the samples.
    """

    events: Events = field(kw_only=True)
    of: Mapping[str, RecordNoise] = field(kw_only=True)
    noise_dof: float = field(kw_only=True)
    current_noise_dof: float = field(kw_only=True)
    sampled: bool = False

    def scaled(self, factor: float) -> "EventNoise":
        """The same: a record tells its noise."""
        return self

    def only(self, *names: str) -> "EventNoise":
        """Of these records alone."""
        return replace(
            self, events=self.events.only(*names), of={name: self.of[name] for name in names}
        )

    def until(self, seconds: float) -> "EventNoise":
        """Of the same records, which end so long after their events begin."""
        records = tuple(one.until(one.rest_end + seconds) for one in self.events.records)
        cut = {one.name: self.of[one.name].cut(len(one.time)) for one in records}
        return replace(self, events=replace(self.events, records=records), of=cut)

    @cached_property
    def for_predictions(self) -> "EventNoise":
        """Of the same records as predictions are judged, with fewer samples where there are many:
        as many as these need.
        """
        return self._decimated_to(PREDICTED_RATE, RecordNoise.of_predictions)

    @cached_property
    def decimated(self) -> "EventNoise":
        """Of the same records with fewer samples where there are many; itself where there are
        not.
        """
        fewer = self._decimated_to(DECIMATED_RATE, RecordNoise.every_kth)
        return self if fewer.events.records == self.events.records else fewer

    def _decimated_to(
        self, least: float, judged: Callable[[RecordNoise, int, float], RecordNoise]
    ) -> "EventNoise":
        """With every k-th sample, so many per s at least. judged : how the noise of a record is
        that of every k-th sample behind a low-pass that leaves a part of each deviation.
        """
        records, of = list[EventRecord](), dict[str, RecordNoise]()
        for record in self.events.records:
            rate, noise = sampling_rate(record.time), self.of[record.name]
            k = 1
            if rate is not None and not (
                record.stepped or record.smeared
            ):  # their rule and window know of no low-pass
                k = max(int(rate / least + 1e-3), 1)
            record, left = record.every_kth(k) if k > 1 else (record, 1.0)
            records.append(record)
            of[record.name] = judged(noise, k, left)
        return replace(self, events=replace(self.events, records=tuple(records)), of=of)

    @property
    def count(self) -> float:
        """Independent numbers in all records: what noise and sampling alone are expected to leave
        of chi2.
        """
        return float(sum(self.of[name].independent.sum() for name in self.events.names))

    @property
    def logarithm(self) -> float:
        """Minus twice the logarithm of what a likelihood is divided by, beyond noise alone: what a
        model pays for its weights.
        """
        return sum(one.logarithm for one in self.of.values())

    @property
    def floors(self) -> dict[str, float]:
        """Record -> NRMSE that noise and sampling alone would leave."""
        return {
            one.name: float(
                np.linalg.norm(self.of[one.name].expected) / np.linalg.norm(one.i - one.i_rest)
            )
            for one in self.events.records
        }

    @property
    def of_current(self) -> float:
        """NRMSE that the noise of the current alone would leave, of the record with the least."""
        norms = self._norms_of_current
        return float(
            min(norms[one.name] / np.linalg.norm(one.i - one.i_rest) for one in self.events.records)
        )

    @property
    def norm_of_current(self) -> float:
        """Norm that the noise of the current alone would leave of all samples, per unit."""
        return float(np.linalg.norm([*self._norms_of_current.values()]))

    @property
    def _norms_of_current(self) -> dict[str, np.floating]:
        """Record -> the same of its samples."""
        return {
            name: np.sqrt(2.0) * np.linalg.norm(one.current_sigma) for name, one in self.of.items()
        }

    def for_model(
        self, player: Player, values: Mapping[str, Mapping[str, float]], pulse_error: float
    ) -> "EventNoise":
        """The same with what a model makes of the voltage that is open.

        values : record -> of the model. pulse_error : how far its answers may be wrong, relative.
        Raises IbridError where it has no rest.
        """
        of, share, by_noise, by_sampling = {}, 0.0, 0.0, 0.0
        for record in self.events.records:
            own, current = values[record.name], self.of[record.name].current_sigma
            if record.smeared:
                of[record.name] = estimator_noise(record, current, player.matrices(record, own))
                by_noise += float(of[record.name].independent.sum())
                continue
            voltage = open_voltage(error_between(record), noise_left(record))
            model, step = player.matrices(record, own), float(np.median(np.diff(record.time)))
            pulses = (
                player.pulse_responses(record, own, voltage.intervals, BUMP)
                if len(voltage.intervals)
                else None
            )
            channels = simulate_errors(
                player, record, own, list_channel_errors(record, self.events)
            )
            waves = np.hstack([channels, list_wave_transients(record, self.events.f0_hz, model)])
            rounding = simulate_errors(player, record, own, list_rounding_errors(record))
            noise = noise_and_sampling(
                current, model, step, voltage, pulses, waves, rounding, pulse_error
            )
            of[record.name] = noise
            part = (current[:, None] / noise.sigma) ** 2
            by_noise += float(part.sum())
            by_sampling += float((noise.independent - part).sum())
            by_recorder = float((waves**2).sum() + (rounding**2).sum())
            by_voltage = (
                float((noise.expected**2).sum()) - by_recorder
            )  # and by the current's own noise
            share = max(share, 1.0 - 2.0 * float((current**2).sum()) / by_voltage)
        spread = by_noise**2 / self.current_noise_dof + by_sampling**2 / SURE
        noise_dof = (by_noise + by_sampling) ** 2 / spread if spread > 0 else np.inf
        sampled = share > SAID
        source = self.source.removesuffix(SAMPLING) + SAMPLING * sampled
        return replace(self, of=of, source=source, noise_dof=noise_dof, sampled=sampled)


def estimator_noise(
    record: EventRecord, current: np.ndarray, matrices: Matrices | None = None
) -> RecordNoise:
    """Of frames of an estimator: their current's noise (N,), and what a model at rest makes of
    their voltage's.

    Law: noise that is white before a window W has behind it the part |W(f)|^2 at each frequency, of
    which a model passes |Y(f)|^2.
    """
    kept, window = ~record.masked, record.window
    if window is None or not record.smeared:
        return noise_alone(current)
    sigma = np.repeat(current[:, None], 2, axis=1)
    if matrices is not None and record.voltage_noise > 0:
        a, b, c, d = matrices
        highest = 0.5 / float(np.median(np.diff(record.time)))
        frequency = (
            (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES * min(highest, 2.0 * window.bandwidth_hz)
        )
        passed = [
            c @ np.linalg.solve(2j * np.pi * f * np.eye(len(a)) - a, b) + d for f in frequency
        ]
        weight = np.abs(window.response(frequency)) ** 2
        share = np.einsum("f,fij->i", weight / weight.sum(), np.abs(passed) ** 2)
        sigma = np.sqrt(sigma**2 + record.voltage_noise**2 * share)
    return noise_of_frames(sigma, kept, correlated(record.time, window, kept))


def list_wave_transients(record: EventRecord, f0_hz: float, matrices: Matrices) -> np.ndarray:
    """(2 N, 4) what rings on in the current since a playback begins without the waves at -f0 and -2
    f0 of the voltage.
    """
    a, b, *_ = matrices
    turn = np.array([1.0, 1.0j])
    step = float(np.median(np.diff(record.time)))
    sizes = waves_at_rest(record, record.v @ turn, f0_hz)[1:]
    states = [
        np.linalg.solve(2j * np.pi * f0_hz * turns * np.eye(len(a)) - a, b) for turns in (1, 2)
    ]
    begun = [size * state @ turn for size, state in zip(sizes, states, strict=True)]
    starts = np.array([part for x in begun for part in (x.real, x.imag)])
    return free_answers(matrices, step, len(record.time), starts).reshape(len(starts), -1).T


def event_noise(events: Events, sweep: Sweep) -> EventNoise:
    """Sigma as given, else the rms of the current at rest about a constant, a slope and ripple of
    the frequency; to both is added `LEAST_UNKNOWN` of the rms of what happens, and the rounding of
    the file's numbers.
    """
    of, freedom, stated = {}, np.inf, True
    for record in events.records:
        floor = LEAST_UNKNOWN * float(np.sqrt(np.mean((record.i - record.i_rest) ** 2)))
        floor = float(np.hypot(floor, record.current_step / np.sqrt(12.0)))
        own = record.sigma
        if own is None:
            level, count = noise_at_rest(record, events.f0_hz)
            own, stated = np.full(len(record.time), level), False
            if level > floor:
                freedom = min(freedom, count)
        of[record.name] = estimator_noise(record, np.hypot(own, max(floor, 1e-9)))
    source = "the sigma of the records" if stated else "the current at rest before each event"
    return EventNoise(
        sweep, True, source, events=events, of=of, noise_dof=freedom, current_noise_dof=freedom
    )
