"""Sweeps at several amplitudes as one array, and the errors by which a quasi-linear model is judged
on them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrid.measurement.sweeps.amplitudes import at_amplitudes
from ibrid.measurement.sweeps.linearity import with_products
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.sweep import Sweep

#: Part of the measured change with the amplitude that a describing function may be wrong by: it
#: neglects high harmonics and what the distortion does elsewhere.
DISTORTION = 0.05
#: Allowed error over |Y| of a frequency, operating point and amplitude from which on it is not
#: counted in an NRMSE.
LOOSE = 0.1


@dataclass(frozen=True, eq=False)
class AmplitudeData:
    """K frequencies, M operating points, L amplitudes. `sweep` : the smallest amplitude on the
    common grid. `frequency` : (K,) Hz. `amplitude` : (K, M, L) per unit. `admittance` : (K, M, L,
    2, 2). `weight` : the same shape, 1/sigma of each real and imaginary part, 0 where nothing was
    measured. `pooled` : the mean of the amplitudes, with its sigma: what a linear model is fitted
    to. `within` : chi2 of the amplitudes about that mean, which no linear model explains.
    `floor` : NRMSE that noise alone would leave, the mean over operating points and amplitudes;
    None where it is not known.
    """

    sweep: Sweep
    frequency: np.ndarray
    amplitude: np.ndarray
    admittance: np.ndarray
    weight: np.ndarray
    pooled: Sweep
    within: float
    floor: float | None

    @property
    def measurement_count(self) -> int:
        """Measured real numbers."""
        return 2 * int((self.weight > 0).sum())

    def nrmse(self, response: np.ndarray) -> float:
        """Mean over operating points and amplitudes of |Y - data| over |data|; response : as
        `admittance`.

        Where more than `LOOSE` of |Y| is allowed for, as at a resonance that a large amplitude
        drives beyond 1 pu, nothing counts.
        """
        measured = (self.weight > 0)[..., 0, 0]
        allowed = np.sqrt(
            2.0 * (np.where(self.weight > 0, self.weight, 1.0) ** -2.0).sum(axis=(-2, -1))
        )
        there = measured & (allowed < LOOSE * np.linalg.norm(self.admittance, axis=(-2, -1)))
        there = there if there.any() else measured
        error = (np.abs(response - self.admittance) ** 2).sum(axis=(-2, -1)) * there
        whole = (np.abs(self.admittance) ** 2).sum(axis=(-2, -1)) * there
        total = whole.sum(axis=0)
        return float(np.mean(np.sqrt(error.sum(axis=0)[total > 0] / total[total > 0])))

    def linear_nrmse(self, responses: Sequence[np.ndarray]) -> float:
        """The same of a linear model, (K, 2, 2) for each operating point."""
        return self.nrmse(
            np.broadcast_to(np.stack(responses, axis=1)[:, :, None], self.admittance.shape)
        )

    def spread_to_cells(self, value: np.ndarray) -> np.ndarray:
        """What operating points have, (M, r), for each of the C = K M L 2 cells (frequency, point,
        amplitude, axis): (C, r).
        """
        spread = np.broadcast_to(
            value[None, :, None, None], (*self.amplitude.shape, 2, value.shape[1])
        )
        return spread.reshape(-1, value.shape[1])

    def columns(self, matrices: np.ndarray) -> np.ndarray:
        """(K, M, L, 2, 2) -> (C, 2), the columns of each matrix."""
        return np.swapaxes(matrices, -1, -2).reshape(-1, 2)

    def matrices(self, columns: np.ndarray) -> np.ndarray:
        """The opposite of `columns`."""
        return np.swapaxes(columns.reshape(*self.amplitude.shape, 2, 2), -1, -2)


def amplitude_data(sweep: Sweep) -> AmplitudeData | None:
    """Arrays of a sweep with several amplitudes, on the frequencies that all operating points have;
    None without any.

    Law: sigma^2 = noise^2 + (products of signals, a^2 |Y|_F)^2 + (DISTORTION times the largest
    change between amplitudes)^2, the latter two as rms errors of the matrix.
    """
    levels = at_amplitudes(sweep)
    common = set.intersection(*(set(point.frequency.tolist()) for point in levels[0].points))
    frequency = np.array(sorted(common))
    if not len(frequency):
        return None
    names = levels[0].names
    shape = (len(frequency), len(names), len(levels))
    amplitude, admittance = np.full(shape, 1e-3), np.zeros((*shape, 2, 2), dtype=complex)
    variance = np.full((*shape, 2, 2), np.inf)
    for number, level in enumerate(levels):
        for point in map(with_products, level.points):
            m = names.index(point.op.name)
            _, here, there = np.intersect1d(frequency, point.frequency, return_indices=True)
            amplitude[here, m, number] = np.asarray(point.amplitude)[there]
            admittance[here, m, number] = point.admittance[there]
            variance[here, m, number] = np.asarray(point.sigma)[there] ** 2
    measured = np.isfinite(variance)
    variance += _distortion_variance(admittance, measured)[:, :, None]
    weight = np.where(measured, variance, 1.0) ** -0.5 * measured
    total = (weight**2).sum(axis=2)
    mean = (weight**2 * admittance).sum(axis=2) / total
    within = float((np.abs(weight * (admittance - mean[:, :, None])) ** 2).sum())
    points = tuple(
        replace(
            point,
            frequency=frequency,
            admittance=mean[:, m],
            sigma=total[:, m] ** -0.5,
            repeats=None,
            amplitude=None,
        )
        for m, point in enumerate(levels[0].points)
    )
    smallest = tuple(
        replace(
            point,
            frequency=frequency,
            admittance=admittance[:, m, 0],
            sigma=variance[:, m, 0] ** 0.5,
            repeats=None,
            amplitude=amplitude[:, m, 0],
        )
        for m, point in enumerate(levels[0].points)
    )
    return AmplitudeData(
        replace(sweep, points=smallest),
        frequency,
        amplitude,
        admittance,
        weight,
        replace(sweep, points=points),
        within,
        _noise_floor(levels),
    )


def _distortion_variance(admittance: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Variance of each part (K, M, 1, 1) that goes with the largest change between amplitudes."""
    there = measured[..., 0, 0]
    change = np.linalg.norm(admittance[:, :, :, None] - admittance[:, :, None], axis=(-2, -1))
    both = there[:, :, :, None] & there[:, :, None]
    largest = np.where(both, change, 0.0).max(axis=(2, 3))
    return (DISTORTION * largest)[..., None, None] ** 2 / 8.0


def _noise_floor(levels: Sequence[Sweep]) -> float | None:
    points = [(point, estimate_point(point).sigma) for level in levels for point in level.points]
    floors = [
        float(np.sqrt(2.0 * (sigma**2).sum()) / np.linalg.norm(point.admittance))
        for point, sigma in points
        if sigma is not None
    ]
    return float(np.mean(floors)) if len(floors) == len(points) else None
