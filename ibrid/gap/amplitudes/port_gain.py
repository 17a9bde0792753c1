"""The measured gain of a port with a nonlinearity, beside its describing function.

Each frequency, operating point, amplitude and axis shows a gain of its own at the fitted
parameters: w/z, which a filter makes complex and a function of frequency, and a memoryless
nonlinearity real and a function of the amplitude alone.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.gap.amplitudes.amplitude_data import AmplitudeData
from ibrid.gap.amplitudes.nonlinearity_fit import NonlinearityFit

#: Standard error of a measured gain above which it is left out.
LARGEST_DEVIATION = 0.2
#: Points of the describing function's curve.
CURVE_POINTS = 300


@dataclass(frozen=True, eq=False)
class PortGain:
    """Measured gains of a port in N cells.

    Parameters
    ----------
    amplitude : ndarray
        (N,) at the port, over the threshold (of a limit: over the room that the operating value
        leaves).
    gain, deviation : ndarray
        (N,) complex, and the standard error of its parts.
    frequency : ndarray
        (N,) Hz.
    level : ndarray
        (N,) number of the injection amplitude.
    curve : ndarray
        (2, 300) amplitude and value of the describing function.
    """

    amplitude: np.ndarray
    gain: np.ndarray
    deviation: np.ndarray
    frequency: np.ndarray
    level: np.ndarray
    curve: np.ndarray


def port_gain(fit: NonlinearityFit, data: AmplitudeData) -> PortGain:
    """Compute the measured gains of a fit's port, along the direction in which it acts."""
    point = fit.point
    nonlinearity = fit.edit.nonlinearity
    steady = data.spread_to_cells(point.steady)
    room = np.full(len(steady), fit.threshold)
    if nonlinearity.is_limit:
        room = fit.threshold - nonlinearity.limited_magnitude(steady)
    direction = nonlinearity.direction(steady)
    weight = data.columns(data.weight)
    is_measured = weight > 0
    entering, gain, sensitivity = _measure_gain(fit, data, direction)
    sigma = np.where(is_measured, 1.0 / np.where(is_measured, weight, 1.0), 0.0)
    size = point.linear.amplitude[:, None]
    changes = np.where(is_measured, sensitivity, 0.0) * size * sigma
    deviation = np.linalg.norm(changes, axis=1) / np.abs(entering)
    is_accurate = deviation < LARGEST_DEVIATION
    shown = is_accurate & is_measured.all(axis=1) & np.isfinite(gain)
    shape = (*data.amplitude.shape, 2)
    frequency = np.broadcast_to(data.frequency[:, None, None, None], shape).reshape(-1)
    levels = np.arange(data.amplitude.shape[2])
    level = np.broadcast_to(levels[None, None, :, None], shape).reshape(-1)
    amplitude = (np.abs(entering) / room)[shown]
    lowest = float(amplitude.min(initial=0.1))
    highest = float(amplitude.max(initial=2.0))
    at = np.geomspace(max(0.8 * lowest, 1e-3), max(1.3 * highest, 3.0), CURVE_POINTS)
    return PortGain(
        amplitude=amplitude,
        gain=gain[shown],
        deviation=deviation[shown],
        frequency=frequency[shown],
        level=level[shown],
        curve=np.array([at, nonlinearity.gain(at, 1.0)]),
    )


def _measure_gain(
    fit: NonlinearityFit, data: AmplitudeData, direction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the signal z (C,), the gain w/z (C,), and what an error of the current does to w/z
    times z, (C, 2), along directions (C, r).

    w is what explains the measured current; z follows from it.
    """
    linear = fit.point.linear
    shape = fit.point.motion.entering.shape
    weight = data.columns(data.weight)
    inverse = np.linalg.pinv(weight[..., None] * linear.y_w) * weight[:, None, :]
    current = linear.amplitude[:, None] * (data.columns(data.admittance) - linear.y_u)
    w = np.einsum("cij,cj->ci", inverse, current)
    drive = linear.drive.reshape(shape)
    back = linear.back.reshape(*shape, *shape[1:])
    z_u = drive[..., 1] + 1j * drive[..., 2]
    z_w = back[:, :, 1, :, 1] + 1j * back[:, :, 2, :, 1]
    z = z_u + np.einsum("cij,cj->ci", z_w, w)
    entering = (direction * z).sum(axis=1)
    leaving = (direction * w).sum(axis=1)
    gain = leaving / entering
    by_leaving = np.einsum("ci,cij->cj", direction, inverse)
    by_entering = np.einsum("ci,cij,cjk->ck", direction, z_w, inverse)
    return entering, gain, by_leaving - gain[:, None] * by_entering
