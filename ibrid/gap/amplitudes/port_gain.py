"""The gain of a port as the amplitudes show it: at every frequency, operating point, amplitude and
axis by itself.
"""

from dataclasses import dataclass

import numpy as np

from ibrid.gap.amplitudes.amplitude_data import AmplitudeData
from ibrid.gap.amplitudes.nonlinearity_fit import NonlinearityFit

#: Standard error of a measured gain from which on it says nothing.
USELESS = 0.2


@dataclass(frozen=True, eq=False)
class PortGain:
    """The gain of a port as measured, each cell by itself, at the fitted parameters: N = w/z, which
    a filter would make complex and a function of frequency, and a memoryless nonlinearity real and
    one of amplitude alone.

    `amplitude` : (N,) at the port, over the threshold (of a limit: over the room that the value at
    rest leaves). `gain`,
    `deviation` : (N,) complex, and the standard error of its parts. `frequency` : (N,) Hz. `level`
    : (N,) number of the injection amplitude. `curve` : (2, C) of the describing function.
    """

    amplitude: np.ndarray
    gain: np.ndarray
    deviation: np.ndarray
    frequency: np.ndarray
    level: np.ndarray
    curve: np.ndarray


def port_gain(fit: NonlinearityFit, data: AmplitudeData) -> PortGain:
    """Measured gains of a fit's port along the direction in which it acts."""
    state, shape = fit.state, fit.place.shape
    linear, coefficients = state.linear, state.motion.entering.shape
    rest = data.spread_to_cells(state.rest)
    along = shape.along(rest)
    room = (
        fit.threshold - shape.rest_size(rest) if shape.limits else np.full(len(rest), fit.threshold)
    )
    weight, size = data.columns(data.weight), linear.amplitude[:, None]
    inverse = np.linalg.pinv(weight[..., None] * linear.y_w) * weight[:, None, :]
    w = np.einsum("cij,cj->ci", inverse, size * (data.columns(data.admittance) - linear.y_u))
    drive, back = (
        linear.drive.reshape(coefficients),
        linear.back.reshape(*coefficients, *coefficients[1:]),
    )
    z_u = drive[..., 1] + 1j * drive[..., 2]
    z_w = back[:, :, 1, :, 1] + 1j * back[:, :, 2, :, 1]
    z = z_u + np.einsum("cij,cj->ci", z_w, w)
    entering, leaving = (along * z).sum(axis=1), (along * w).sum(axis=1)
    gain = leaving / entering
    moves = np.einsum("ci,cij->cj", along, inverse) - gain[:, None] * np.einsum(
        "ci,cij,cjk->ck", along, z_w, inverse
    )
    there = weight > 0
    sigma = np.where(there, 1.0 / np.where(there, weight, 1.0), 0.0)
    deviation = np.linalg.norm(np.where(there, moves, 0.0) * size * sigma, axis=1) / np.abs(
        entering
    )
    seen = (deviation < USELESS) & there.all(axis=1) & np.isfinite(gain)
    frequency, level = (
        np.broadcast_to(one, (*data.amplitude.shape, 2)).reshape(-1)
        for one in (
            data.frequency[:, None, None, None],
            np.arange(data.amplitude.shape[2])[None, None, :, None],
        )
    )
    amplitude = np.abs(entering) / room
    low, high = float(amplitude[seen].min(initial=0.1)), float(amplitude[seen].max(initial=2.0))
    at = np.geomspace(max(0.8 * low, 1e-3), max(1.3 * high, 3.0), 300)
    return PortGain(
        amplitude[seen],
        gain[seen],
        deviation[seen],
        frequency[seen],
        level[seen],
        np.array([at, shape.gain(at, 1.0)]),
    )
