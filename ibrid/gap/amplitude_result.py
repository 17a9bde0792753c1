"""What the amplitudes of a measurement say: where it is linear, which nonlinearity explains the rest, and its curve."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.gap.nonlinear_data import AmplitudeData
from ibrid.gap.port_gain import PortGain
from ibrid.measurement.linearity import Linearity

#: Fewest frequencies of every operating point from which a small-signal answer can be had.
FEWEST = 4
#: Allowed error over |Y| of a frequency, operating point and amplitude from which on it is not counted in an NRMSE.
LOOSE = 0.1


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
