"""What the amplitudes of a measurement say: where it is linear, which nonlinearity explains the rest, and its curve."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.gap.describing import dead_zone_gain, held_limit_gain, saturation_gain
from ibrid.gap.nonlinear_data import AmplitudeData
from ibrid.gap.nonlinear_fit import NonlinearFit
from ibrid.gap.nonlinear_shapes import D_LIMIT, DEAD_ZONE, Q_LIMIT, SATURATION, rest_size
from ibrid.measurement.linearity import Linearity

#: Fewest frequencies of every operating point from which a small-signal answer can be had.
FEWEST = 4
#: Allowed error over |Y| of a frequency, operating point and amplitude from which on it is not counted in an NRMSE.
LOOSE = 0.1
#: Standard error of a measured gain from which on it says nothing.
USELESS = 0.2


@dataclass(frozen=True)
class TriedNonlinearity:
    """A nonlinearity that was fitted. `gain` : fall of the cost below the linear model's. `threshold` : as fitted."""

    id: str
    words: str
    where: str
    gain: float
    chi2_per_dof: float
    p_value: float
    threshold: float


@dataclass(frozen=True, eq=False)
class PortGain:
    """The gain of a port as measured, each cell by itself, at the fitted parameters: N = w/z, which a filter would make
    complex and a function of frequency, and a memoryless nonlinearity real and one of amplitude alone.

    `amplitude` : (N,) at the port, over the threshold (of a limit: over the room that the value at rest leaves). `gain`,
    `deviation` : (N,) complex, and the standard error of its parts. `frequency` : (N,) Hz. `level` : (N,) number of the
    injection amplitude. `curve` : (2, C) of the describing function.
    """

    amplitude: np.ndarray
    gain: np.ndarray
    deviation: np.ndarray
    frequency: np.ndarray
    level: np.ndarray
    curve: np.ndarray


@dataclass(frozen=True, eq=False)
class AmplitudeAnswer:
    """`linearity` : the gate. `kept` : number of frequencies that the small-signal answer rests on. `words` : of the
    nonlinearity, "" where none is believed. `tried` : every place, the best first. `before`, `after`, `floor` : NRMSE over
    all amplitudes of the linear model, of that with the nonlinearity, and of noise alone. `gain` : of its port."""

    linearity: Linearity
    kept: int
    words: str = ""
    parameter: str = ""
    tried: tuple[TriedNonlinearity, ...] = ()
    before: float | None = None
    after: float | None = None
    floor: float | None = None
    port_gain: PortGain | None = None


def port_gain(fit: NonlinearFit, data: AmplitudeData) -> PortGain:
    """Measured gains of a fit's port along the direction in which it acts."""
    state, shape = fit.state, fit.place.shape
    linear, motion = state.linear, state.motion
    rest = np.broadcast_to(state.rest[None, :, None, None], (*data.amplitude.shape, 2, state.rest.shape[1]))
    rest = rest.reshape(len(linear.amplitude), -1)
    along = _direction(fit, rest)
    room = fit.threshold - rest_size(shape, rest) if shape.limits else np.full(len(rest), fit.threshold)
    columns = np.swapaxes(data.admittance, -1, -2).reshape(-1, 2)
    weight = np.swapaxes(data.weight, -1, -2).reshape(-1, 2)
    size = linear.amplitude[:, None]
    inverse = np.linalg.pinv(weight[..., None] * linear.y_w) * weight[:, None, :]
    w = np.einsum("cij,cj->ci", inverse, size * (columns - linear.y_u))
    drive = linear.drive.reshape(*motion.entering.shape)
    z_u = drive[..., 1] + 1j * drive[..., 2]
    back = linear.back.reshape(*motion.entering.shape, *motion.entering.shape[1:])
    z_w = back[:, :, 1, :, 1] + 1j * back[:, :, 2, :, 1]
    z = z_u + np.einsum("cij,cj->ci", z_w, w)
    entering, leaving = (along * z).sum(axis=1), (along * w).sum(axis=1)
    gain = leaving / entering
    moves = np.einsum("ci,cij->cj", along, inverse) - gain[:, None] * np.einsum("ci,cij,cjk->ck", along, z_w, inverse)
    sigma = np.where(weight > 0, 1.0 / np.where(weight > 0, weight, 1.0), np.inf)
    deviation = np.linalg.norm(
        np.where(weight > 0, moves, 0.0) * size * np.where(np.isfinite(sigma), sigma, 0.0), axis=1
    )
    deviation = deviation / np.abs(entering)
    frequency, level = (np.broadcast_to(one, (*data.amplitude.shape, 2)).reshape(-1) for one in (
        data.frequency[:, None, None, None], np.arange(data.amplitude.shape[2])[None, None, :, None]))  # fmt: skip
    seen = (deviation < USELESS) & (weight > 0).all(axis=1) & np.isfinite(gain)
    amplitude = np.abs(entering) / room
    top = 1.3 * float(amplitude[seen].max(initial=2.0))
    at = np.geomspace(max(0.8 * float(amplitude[seen].min(initial=0.1)), 1e-3), max(top, 3.0), 300)
    return PortGain(
        amplitude[seen], gain[seen], deviation[seen], frequency[seen], level[seen], np.array([at, _curve(fit, at)])
    )


def _direction(fit: NonlinearFit, rest: np.ndarray) -> np.ndarray:
    """Unit vectors (C, r): of the axis that is limited, of the value at rest, or of a scalar."""
    if fit.place.shape in (D_LIMIT, Q_LIMIT):
        axis = np.eye(2)[0 if fit.place.shape is D_LIMIT else 1]
        return np.broadcast_to(axis, rest.shape)
    if not fit.place.shape.limits:
        return np.eye(rest.shape[1])[np.zeros(len(rest), dtype=int)]
    return rest / np.linalg.norm(rest, axis=1, keepdims=True)


def _curve(fit: NonlinearFit, amplitude: np.ndarray) -> np.ndarray:
    """The describing function over the amplitude that `PortGain` has."""
    if fit.place.shape is DEAD_ZONE:
        return dead_zone_gain(amplitude, 1.0)
    return saturation_gain(amplitude, 1.0) if fit.place.shape is SATURATION else held_limit_gain(amplitude, 1.0)


def nrmse_at_all(data: AmplitudeData, response: np.ndarray) -> float:
    """Mean over operating points and amplitudes of |Y - data| over |data|; response : as `data.admittance`.

    Where more than `LOOSE` of |Y| is allowed for, as at a resonance that a large amplitude drives beyond 1 pu, nothing counts.
    """
    measured = (data.weight > 0)[..., 0, 0]
    allowed = np.sqrt(2.0 * (np.where(data.weight > 0, data.weight, 1.0) ** -2.0).sum(axis=(-2, -1)))
    there = measured & (allowed < LOOSE * np.linalg.norm(data.admittance, axis=(-2, -1)))
    there = there if there.any() else measured
    error = (np.abs(response - data.admittance) ** 2).sum(axis=(-2, -1)) * there
    whole = (np.abs(data.admittance) ** 2).sum(axis=(-2, -1)) * there
    total = whole.sum(axis=0)
    return float(np.mean(np.sqrt(error.sum(axis=0)[total > 0] / total[total > 0])))


def at_every_amplitude(responses: Sequence[np.ndarray], data: AmplitudeData) -> np.ndarray:
    """Responses of a linear model, (K, 2, 2) for each operating point, as `data.admittance`."""
    return np.broadcast_to(np.stack(responses, axis=1)[:, :, None], data.admittance.shape)
