"""The noise of recordings: of the current, and what a model makes of the voltage that is unknown.

The unknown voltage is that between the samples, and what its own noise and the systematic errors of
the recorder make of it.
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

#: Degrees of freedom of the estimate of the voltage between samples: for sampled edits it is right
#: to a factor of two, rms.
SAMPLING_DOF = 10.0
#: Voltage pulse by which the response of the current to it is computed, per unit.
PULSE = 1e-4
#: Relative error of such responses: of a model at nominal or typical parameters, and of one that
#: explains the recordings.
NOMINAL_PULSE_ERROR = 0.3
FITTED_PULSE_ERROR = 0.1
#: Least sampling rate, 1/s, of prediction errors, and of descents far from the noise: both only
#: have to lead to the right valley of the cost.
PREDICTION_RATE = 8e3
DECIMATION_RATE = 5e3
#: Frequencies at which the part of the voltage noise that a model passes is summed.
FREQUENCIES = 24
#: Part of the noise floor due to the unknown voltage from which that is reported, and the words.
REPORTED_SHARE = 0.3
SAMPLING_WORDS = ", and what sampling leaves open of the voltage"
#: Noise of the current that is assumed at least, per unit.
LEAST_SIGMA = 1e-9


@dataclass(frozen=True, eq=False)
class EventNoise(Noise):
    """The noise of recordings.

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
        Much of the noise is due to the unknown voltage between the samples.
    """

    events: Events = field(kw_only=True)
    of: Mapping[str, RecordNoise] = field(kw_only=True)
    noise_dof: float = field(kw_only=True)
    current_noise_dof: float = field(kw_only=True)
    sampled: bool = False

    def scaled(self, factor: float) -> "EventNoise":
        """Return the noise unchanged: recordings show its level."""
        return self

    def only(self, *names: str) -> "EventNoise":
        """Return the noise of these records alone."""
        of = {name: self.of[name] for name in names}
        return replace(self, events=self.events.only(*names), of=of)

    def until(self, seconds: float) -> "EventNoise":
        """Return the noise of the records cut so many seconds after their events begin."""
        records = tuple(record.until(record.rest_end + seconds) for record in self.events.records)
        of = {record.name: self.of[record.name].cut(len(record.time)) for record in records}
        return replace(self, events=replace(self.events, records=records), of=of)

    @cached_property
    def for_predictions(self) -> "EventNoise":
        """The noise that weights prediction errors, with no more samples than these need."""
        return self._decimated_to(PREDICTION_RATE, RecordNoise.of_predictions)

    @cached_property
    def decimated(self) -> "EventNoise":
        """The noise of decimated records; itself where there are few samples."""
        decimated = self._decimated_to(DECIMATION_RATE, RecordNoise.every_kth)
        return self if decimated.events.records == self.events.records else decimated

    def _decimated_to(
        self, least_rate: float, decimate: Callable[[RecordNoise, int, float], RecordNoise]
    ) -> "EventNoise":
        """Keep every k-th sample, at `least_rate` (1/s) or more.

        decimate : returns the noise of every k-th sample behind a low-pass that leaves a part of
        each standard deviation.
        """
        records: list[EventRecord] = []
        of: dict[str, RecordNoise] = {}
        for record in self.events.records:
            k = _decimation_factor(record, least_rate)
            decimated, remainder = record.every_kth(k) if k > 1 else (record, 1.0)
            records.append(decimated)
            of[record.name] = decimate(self.of[record.name], k, remainder)
        return replace(self, events=replace(self.events, records=tuple(records)), of=of)

    @property
    def count(self) -> float:
        """Independent numbers in all records: the chi2 expected of noise and sampling alone."""
        return float(sum(self.of[name].independent.sum() for name in self.events.names))

    @property
    def logarithm(self) -> float:
        """-2 ln of the normalisation of the likelihood, in excess of that of noise alone.

        Models that weight the recordings differently are compared with this added to their cost.
        """
        return sum(noise.logarithm for noise in self.of.values())

    @property
    def floors(self) -> dict[str, float]:
        """NRMSE of each record that noise and sampling alone would leave."""
        return {
            record.name: float(
                np.linalg.norm(self.of[record.name].expected)
                / np.linalg.norm(record.i - record.i_rest)
            )
            for record in self.events.records
        }

    @property
    def of_current(self) -> float:
        """NRMSE that the noise of the current alone would leave, of the record with the least."""
        norms = self._current_norms
        errors = [
            norms[record.name] / np.linalg.norm(record.i - record.i_rest)
            for record in self.events.records
        ]
        return float(min(errors))

    @property
    def norm_of_current(self) -> float:
        """Norm that the noise of the current alone would leave of all samples, per unit."""
        return float(np.linalg.norm([*self._current_norms.values()]))

    @property
    def _current_norms(self) -> dict[str, np.floating]:
        """Norm of the noise of the current in each record, per unit."""
        return {
            name: np.sqrt(2.0) * np.linalg.norm(noise.current_sigma)
            for name, noise in self.of.items()
        }

    def for_model(
        self, player: Player, values: Mapping[str, Mapping[str, float]], pulse_error: float
    ) -> "EventNoise":
        """Return the noise with what a model makes of the unknown voltage.

        Parameters
        ----------
        values : mapping
            Record -> parameter values of the model.
        pulse_error : float
            Relative error of the model's responses to that voltage.

        Raises
        ------
        IbridError
            The model has no equilibrium.
        """
        of: dict[str, RecordNoise] = {}
        largest_share = 0.0
        by_noise = 0.0
        by_sampling = 0.0
        for record in self.events.records:
            own_values = values[record.name]
            sigma = self.of[record.name].current_sigma
            if record.smeared:
                noise = estimator_noise(record, sigma, player.matrices(record, own_values))
                of[record.name] = noise
                by_noise += float(noise.independent.sum())
                continue
            noise, recorder_square = self._noise_of_record(
                record, sigma, player, own_values, pulse_error
            )
            of[record.name] = noise
            noise_part = (sigma[:, None] / noise.sigma) ** 2
            by_noise += float(noise_part.sum())
            by_sampling += float((noise.independent - noise_part).sum())
            # of the unknown voltage and of the current's own noise
            remainder = float((noise.expected**2).sum()) - recorder_square
            largest_share = max(largest_share, 1.0 - 2.0 * float((sigma**2).sum()) / remainder)
        spread = by_noise**2 / self.current_noise_dof + by_sampling**2 / SAMPLING_DOF
        noise_dof = (by_noise + by_sampling) ** 2 / spread if spread > 0 else np.inf
        sampled = largest_share > REPORTED_SHARE
        source = self.source.removesuffix(SAMPLING_WORDS) + SAMPLING_WORDS * sampled
        return replace(self, of=of, source=source, noise_dof=noise_dof, sampled=sampled)

    def _noise_of_record(
        self,
        record: EventRecord,
        sigma: np.ndarray,
        player: Player,
        values: Mapping[str, float],
        pulse_error: float,
    ) -> tuple[RecordNoise, float]:
        """Return the noise of one record, and the sum of squares of the recorder's errors in it.

        sigma : (N,) of the current.
        """
        voltage = open_voltage(error_between(record), noise_left(record))
        matrices = player.matrices(record, values)
        step = float(np.median(np.diff(record.time)))
        pulses = None
        if len(voltage.intervals):
            pulses = player.pulse_responses(record, values, voltage.intervals, PULSE)
        channel_errors = list_channel_errors(record, self.events)
        channels = simulate_errors(player, record, values, channel_errors)
        transients = list_wave_transients(record, self.events.f0_hz, matrices)
        waves = np.hstack([channels, transients])
        rounding = simulate_errors(player, record, values, list_rounding_errors(record))
        noise = noise_and_sampling(
            sigma, matrices, step, voltage, pulses, waves, rounding, pulse_error
        )
        return noise, float((waves**2).sum() + (rounding**2).sum())


def _decimation_factor(record: EventRecord, least_rate: float) -> int:
    """Return k for every k-th sample at `least_rate` (1/s) or more.

    1 for the steps of a program and the frames of an estimator, which a low-pass would change.
    """
    rate = sampling_rate(record.time)
    if rate is None or record.stepped or record.smeared:
        return 1
    return max(int(rate / least_rate + 1e-3), 1)


def estimator_noise(
    record: EventRecord, sigma: np.ndarray, matrices: Matrices | None = None
) -> RecordNoise:
    """Return the noise of the frames of an estimator, with what a model makes of the voltage noise.

    Law: noise that is white in front of a window W has the spectrum |W(f)|^2 behind it, of which a
    model passes |Y(f)|^2.

    Parameters
    ----------
    sigma : ndarray
        (N,) of the current.
    matrices : tuple of ndarray or None
        A, B, C, D of the model in steady state, voltage to current.
    """
    kept = ~record.masked
    window = record.window
    if window is None or not record.smeared:
        return noise_alone(sigma)
    sigmas = np.repeat(sigma[:, None], 2, axis=1)
    if matrices is not None and record.voltage_noise > 0:
        a, b, c, d = matrices
        nyquist = 0.5 / float(np.median(np.diff(record.time)))
        highest = min(nyquist, 2.0 * window.bandwidth_hz)
        frequency = (np.arange(FREQUENCIES) + 0.5) / FREQUENCIES * highest
        identity = np.eye(len(a))
        admittance = [c @ np.linalg.solve(2j * np.pi * f * identity - a, b) + d for f in frequency]
        weight = np.abs(window.response(frequency)) ** 2
        passed = np.einsum("f,fij->i", weight / weight.sum(), np.abs(admittance) ** 2)
        sigmas = np.sqrt(sigmas**2 + record.voltage_noise**2 * passed)
    return noise_of_frames(sigmas, kept, correlated(record.time, window, kept))


def list_wave_transients(record: EventRecord, f0_hz: float, matrices: Matrices) -> np.ndarray:
    """Return the transients (2 N, 4) of a simulation that begins without two waves of the voltage.

    The recorder's errors rotate at -f0 and -2 f0 (see `systematic_errors`); the states that they
    excite in steady state are missing at the start. Columns: real and imaginary part of each wave.
    """
    a, b, *_ = matrices
    to_dq = np.array([1.0, 1.0j])
    step = float(np.median(np.diff(record.time)))
    magnitudes = waves_at_rest(record, record.v @ to_dq, f0_hz)[1:]
    identity = np.eye(len(a))
    states = [
        np.linalg.solve(2j * np.pi * f0_hz * multiple * identity - a, b) for multiple in (1, 2)
    ]
    pairs = zip(magnitudes, states, strict=True)
    missing = [magnitude * state @ to_dq for magnitude, state in pairs]
    starts = np.array([part for x in missing for part in (x.real, x.imag)])
    transients = free_answers(matrices, step, len(record.time), starts)
    return transients.reshape(len(starts), -1).T


def estimate_event_noise(events: Events, sweep: Sweep) -> EventNoise:
    """Estimate the noise of the current of each record.

    Sigma as given, else the rms of the steady-state current about a constant, a slope and ripple of
    the grid frequency; to both are added `LEAST_UNKNOWN` of the rms of the response, and the
    rounding of the file's numbers.
    """
    of: dict[str, RecordNoise] = {}
    dof = np.inf
    is_declared = True
    for record in events.records:
        floor = LEAST_UNKNOWN * float(np.sqrt(np.mean((record.i - record.i_rest) ** 2)))
        floor = float(np.hypot(floor, record.current_step / np.sqrt(12.0)))
        sigma = record.sigma
        if sigma is None:
            is_declared = False
            level, count = noise_at_rest(record, events.f0_hz)
            sigma = np.full(len(record.time), level)
            if level > floor:
                dof = min(dof, count)
        of[record.name] = estimator_noise(record, np.hypot(sigma, max(floor, LEAST_SIGMA)))
    source = "the current at rest before each event"
    if is_declared:
        source = "the sigma of the records"
    return EventNoise(
        sweep, True, source, events=events, of=of, noise_dof=dof, current_noise_dof=dof
    )
