"""Power at the terminals against angle and magnitude of the grid's voltage: the P-theta / Q-V
Jacobian and the NFP plot.

Both follow from the admittance and the operating point of the terminals. They are what grid codes
ask of grid-forming devices: a voltage source behind an impedance answers an angle step at once, and
its NFP is flat where droop or inertia rule.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ibrid.analysis.grids.grid import J
from ibrid.analysis.models.linear_model import LinearModel, linear_model, whole_record, with_point
from ibrid.border import methods_take_kinds, takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.measurement.formats.frd import MODEL_GRID
from ibrid.showing import brief, shown
from ibrid.writing import PlainData


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class PowerJacobian(Frozen):
    """[dp, dq] = M [dtheta, dV/V] at the terminals, per unit on the inverter's base, p and q
    delivered.

    `frequency` (K,) Hz. `matrix` (K, 2, 2) complex, per rad and per unit of the voltage. `nfp` (K,)
    complex: dp over the frequency of the grid in per unit of nominal, (omega_0 / s) dp/dtheta;
    negative real where more frequency brings less power.
    `op` : name of the operating point. `omega_0` : rad/s.
    """

    op: str
    frequency: np.ndarray
    matrix: np.ndarray
    omega_0: float

    p_theta = property(lambda self: self.matrix[:, 0, 0], doc="(K,) dp/dtheta, per rad")
    p_v = property(lambda self: self.matrix[:, 0, 1], doc="(K,) dp/(dV/V)")
    q_theta = property(lambda self: self.matrix[:, 1, 0], doc="(K,) dq/dtheta, per rad")
    q_v = property(lambda self: self.matrix[:, 1, 1], doc="(K,) dq/(dV/V)")

    @property
    def nfp(self) -> np.ndarray:
        """(K,) network frequency perturbation plot."""
        return self.omega_0 / (2j * np.pi * self.frequency) * self.p_theta

    def plain(self) -> PlainData:
        """For JSON: complex numbers as [re, im]."""
        named = {
            "p_theta": self.p_theta,
            "p_v": self.p_v,
            "q_theta": self.q_theta,
            "q_v": self.q_v,
            "nfp": self.nfp,
        }
        return {
            "op": self.op,
            "frequency_hz": self.frequency.tolist(),
            **{
                name: np.stack([value.real, value.imag], axis=1).tolist()
                for name, value in named.items()
            },
        }

    def __repr__(self) -> str:
        return brief(f"<PowerJacobian at {self.op}: {len(self.frequency)} frequencies", ">")

    def plot(self, ax: Any = None) -> Any:
        """A matplotlib figure of the four entries and the NFP; with ax=(magnitude, phase), of the
        NFP on those.
        """
        return shown(self, "plotting", "jacobian_plot", ax)

    def _repr_html_(self) -> str:
        """The NFP, for notebooks."""
        return shown(self, "pages.notebook", "jacobian_html")


@takes_kinds
def power_jacobian(
    record: Record, op: str | None = None, frequency: Sequence[float] | np.ndarray | None = None
) -> PowerJacobian:
    """P-theta / Q-V Jacobian and NFP of a record's model, delays exact.

    op : as in `linear_model`. frequency : (K,) Hz above 0, by default `MODEL_GRID`.

    Raises as `linear_model`; IbridError where the operating point of the terminals is not known.
    """
    grid = MODEL_GRID if frequency is None else np.atleast_1d(np.asarray(frequency, dtype=float))
    if not (np.isfinite(grid).all() and (grid > 0).all()):
        raise IbridError(
            "the Jacobian is asked for at frequencies above 0 Hz; the NFP has a pole there"
        )
    model = linear_model(record, op)
    with whole_record():
        whole, name = with_point(record, op)
        return PowerJacobian(
            name, grid, jacobian_of(whole.response(name, grid), model), model.omega_0
        )


def jacobian_of(admittance: np.ndarray, model: LinearModel) -> np.ndarray:
    """M (K, 2, 2) of an admittance (K, 2, 2) of current out at the terminals' operating point.

    p = v' i, q = v' J i, dv = J v0 dtheta + v0 dV/V, di = Y dv.
    """
    v, i = np.array(model.v0), np.array(model.i0)
    if not np.isfinite([v, i]).all():
        raise IbridError(
            "the current at rest does not follow from this plant in closed form; the Jacobian "
            "needs it, declare branches"
        )
    of_voltage, of_current = np.array([i, J @ i]), np.array([v, v @ J])
    directions = np.stack([J @ v, v], axis=1)
    return (of_voltage + of_current @ admittance) @ directions
