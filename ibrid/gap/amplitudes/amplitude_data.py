"""Sweeps at several injection amplitudes as one array, with the weights of a quasi-linear model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrid.measurement.sweeps.amplitudes import at_amplitudes
from ibrid.measurement.sweeps.linearity import with_products
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.sweep import Sweep

#: Part of the measured change with the amplitude by which a describing function may be wrong: it
#: neglects high harmonics, and what the distortion does elsewhere.
DISTORTION = 0.05
#: Allowed error over |Y| of a frequency, operating point and amplitude above which it is left out
#: of an NRMSE.
LOOSE = 0.1
#: Amplitude, per unit, where nothing was measured.
NO_AMPLITUDE = 1e-3


@dataclass(frozen=True, eq=False)
class AmplitudeData:
    """Admittances at K frequencies, M operating points and L injection amplitudes.

    Parameters
    ----------
    sweep : Sweep
        At the smallest amplitude, on the common frequencies.
    frequency : ndarray
        (K,) Hz.
    amplitude : ndarray
        (K, M, L) of the injected voltage, per unit.
    admittance : ndarray
        (K, M, L, 2, 2) per unit.
    weight : ndarray
        (K, M, L, 2, 2), 1/sigma of each real and imaginary part; 0 where nothing was measured.
    pooled : Sweep
        Weighted mean over the amplitudes, with its sigma: what a linear model is fitted to.
    chi2_within : float
        chi2 of the amplitudes about that mean, which no linear model explains.
    floor : float or None
        NRMSE that noise alone would leave, the mean over operating points and amplitudes; None
        where it is not known.
    """

    sweep: Sweep
    frequency: np.ndarray
    amplitude: np.ndarray
    admittance: np.ndarray
    weight: np.ndarray
    pooled: Sweep
    chi2_within: float
    floor: float | None

    @property
    def measurement_count(self) -> int:
        """Measured real numbers."""
        return 2 * int((self.weight > 0).sum())

    def nrmse(self, response: np.ndarray) -> float:
        """Return the mean over operating points and amplitudes of |Y - data| over |data|.

        Cells in which the allowed error exceeds `LOOSE` of |Y| are left out, as at a resonance that
        a large amplitude drives beyond 1 pu.

        response : (K, M, L, 2, 2).
        """
        is_measured = (self.weight > 0)[..., 0, 0]
        variance = np.where(self.weight > 0, self.weight, 1.0) ** -2.0
        allowed = np.sqrt(2.0 * variance.sum(axis=(-2, -1)))
        magnitude = np.linalg.norm(self.admittance, axis=(-2, -1))
        is_counted = is_measured & (allowed < LOOSE * magnitude)
        if not is_counted.any():
            is_counted = is_measured
        error = (np.abs(response - self.admittance) ** 2).sum(axis=(-2, -1)) * is_counted
        square = (np.abs(self.admittance) ** 2).sum(axis=(-2, -1)) * is_counted
        total = square.sum(axis=0)
        ratio = error.sum(axis=0)[total > 0] / total[total > 0]
        return float(np.mean(np.sqrt(ratio)))

    def linear_nrmse(self, responses: Sequence[np.ndarray]) -> float:
        """Return the NRMSE of a linear model, (K, 2, 2) for each operating point."""
        response = np.stack(responses, axis=1)[:, :, None]
        return self.nrmse(np.broadcast_to(response, self.admittance.shape))

    def spread_to_cells(self, value: np.ndarray) -> np.ndarray:
        """Repeat a value (M, r) of each operating point for all cells, (C, r).

        The C = K M L 2 cells are frequency, operating point, amplitude and injected axis.
        """
        shape = (*self.amplitude.shape, 2, value.shape[1])
        return np.broadcast_to(value[None, :, None, None], shape).reshape(-1, value.shape[1])

    def columns(self, matrices: np.ndarray) -> np.ndarray:
        """Return the columns (C, 2) of matrices (K, M, L, 2, 2), one for each cell."""
        return np.swapaxes(matrices, -1, -2).reshape(-1, 2)

    def matrices(self, columns: np.ndarray) -> np.ndarray:
        """Return the matrices (K, M, L, 2, 2) of columns (C, 2)."""
        return np.swapaxes(columns.reshape(*self.amplitude.shape, 2, 2), -1, -2)


def build_amplitude_data(sweep: Sweep) -> AmplitudeData | None:
    """Collect a sweep with several amplitudes on the frequencies that all operating points share.

    Law: sigma^2 = noise^2 + (products of signals, a^2 |Y|_F)^2 + (DISTORTION times the largest
    change between amplitudes)^2, the latter two as rms errors of the matrix.

    Returns
    -------
    AmplitudeData or None
        None where they share no frequency.
    """
    levels = at_amplitudes(sweep)
    common = set.intersection(*(set(point.frequency.tolist()) for point in levels[0].points))
    frequency = np.array(sorted(common))
    if not len(frequency):
        return None
    amplitude, admittance, variance = _stack_levels(levels, frequency)
    is_measured = np.isfinite(variance)
    variance += _distortion_variance(admittance, is_measured)[:, :, None]
    weight = np.where(is_measured, variance, 1.0) ** -0.5 * is_measured
    total = (weight**2).sum(axis=2)
    mean = (weight**2 * admittance).sum(axis=2) / total
    chi2_within = float((np.abs(weight * (admittance - mean[:, :, None])) ** 2).sum())
    pooled = [
        replace(
            point,
            frequency=frequency,
            admittance=mean[:, m],
            sigma=total[:, m] ** -0.5,
            repeats=None,
            amplitude=None,
        )
        for m, point in enumerate(levels[0].points)
    ]
    smallest = [
        replace(
            point,
            frequency=frequency,
            admittance=admittance[:, m, 0],
            sigma=variance[:, m, 0] ** 0.5,
            repeats=None,
            amplitude=amplitude[:, m, 0],
        )
        for m, point in enumerate(levels[0].points)
    ]
    return AmplitudeData(
        sweep=replace(sweep, points=tuple(smallest)),
        frequency=frequency,
        amplitude=amplitude,
        admittance=admittance,
        weight=weight,
        pooled=replace(sweep, points=tuple(pooled)),
        chi2_within=chi2_within,
        floor=_noise_floor(levels),
    )


def _stack_levels(
    levels: Sequence[Sweep], frequency: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stack the sweeps of L amplitudes at frequencies (K,).

    Returns
    -------
    tuple of ndarray
        Amplitude (K, M, L), admittance (K, M, L, 2, 2), and variance of each part (K, M, L, 2, 2),
        infinite where nothing was measured.
    """
    names = levels[0].names
    shape = (len(frequency), len(names), len(levels))
    amplitude = np.full(shape, NO_AMPLITUDE)
    admittance = np.zeros((*shape, 2, 2), dtype=complex)
    variance = np.full((*shape, 2, 2), np.inf)
    for number, level in enumerate(levels):
        for point in map(with_products, level.points):
            m = names.index(point.op.name)
            _, here, there = np.intersect1d(frequency, point.frequency, return_indices=True)
            amplitude[here, m, number] = np.asarray(point.amplitude)[there]
            admittance[here, m, number] = point.admittance[there]
            variance[here, m, number] = np.asarray(point.sigma)[there] ** 2
    return amplitude, admittance, variance


def _distortion_variance(admittance: np.ndarray, is_measured: np.ndarray) -> np.ndarray:
    """Return the variance of each part (K, M, 1, 1) due to the change between amplitudes.

    admittance, is_measured : (K, M, L, 2, 2).
    """
    has_level = is_measured[..., 0, 0]
    change = np.linalg.norm(admittance[:, :, :, None] - admittance[:, :, None], axis=(-2, -1))
    has_both = has_level[:, :, :, None] & has_level[:, :, None]
    largest = np.where(has_both, change, 0.0).max(axis=(2, 3))
    return (DISTORTION * largest)[..., None, None] ** 2 / 8.0


def _noise_floor(levels: Sequence[Sweep]) -> float | None:
    """Return the mean NRMSE that noise alone would leave; None where a noise is not known."""
    points = [point for level in levels for point in level.points]
    floors: list[float] = []
    for point in points:
        sigma = estimate_point(point).sigma
        if sigma is None:
            return None
        error = np.sqrt(2.0 * (sigma**2).sum())
        floors.append(float(error / np.linalg.norm(point.admittance)))
    return float(np.mean(floors))
