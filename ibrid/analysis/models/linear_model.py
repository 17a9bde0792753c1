"""What every export starts from: the matrices of a record at one operating point, their names and
what they mean.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import matrix_balance

from ibrid.border import methods_take_kinds, takes_kinds
from ibrid.errors import DiagramError, IbridError, OperatingPointError, near
from ibrid.evaluation.record import Record
from ibrid.frozen import Frozen
from ibrid.plants.sweeping import operating_point
from ibrid.showing import brief, shown

UNITS = (
    "per unit on the inverter's base, time in s: dx/dt = A x + B [v_D, v_Q], [i_D, i_Q] = C x + D "
    "[v_D, v_Q]; small "
    "deviations, current out of the inverter, q axis leading d"
)


@methods_take_kinds
@dataclass(frozen=True, eq=False)
class LinearModel(Frozen):
    """dx/dt = A x + B v_DQ, i_DQ = C x + D v_DQ, per unit, current out, q leading.

    `states` : "instance.state". `op` : name of the operating point; `p`, `q`, `v` : per unit,
    measured at `power_node`. `v0`, `i0` : (D, Q) at rest at the PCC, from which A, B, C, D deviate.
    `f0_hz` : nominal frequency. `s_base_va`,
    `v_base_v` : base of the per-unit values, None where the measurement did not say. `parameters` :
    free name -> value.
    `pade_orders` : of the delays, instance -> order.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    name: str
    op: str
    p: float
    q: float
    v: float
    power_node: str
    f0_hz: float
    parameters: Mapping[str, float]
    pade_orders: Mapping[str, int]
    v0: tuple[float, float]
    i0: tuple[float, float]
    s_base_va: float | None
    v_base_v: float | None

    def __repr__(self) -> str:
        return brief(f"<LinearModel at {self.op}: {self.name}, {len(self.states)} states", ">")

    def _repr_html_(self) -> str:
        """The terminals at rest, for notebooks."""
        return shown(self, "pages.notebook", "model_html")

    @property
    def omega_0(self) -> float:
        """Nominal angular frequency, rad/s."""
        return 2 * np.pi * self.f0_hz

    @property
    def p_pcc(self) -> float:
        """Active power that the inverter delivers at the PCC, v' i, per unit."""
        return self.v0[0] * self.i0[0] + self.v0[1] * self.i0[1]

    @property
    def q_pcc(self) -> float:
        """Reactive power there, v' J i, per unit."""
        return self.v0[1] * self.i0[0] - self.v0[0] * self.i0[1]

    def at_rest(self) -> dict[str, float]:
        """The terminal operating point by name: per unit, rad/s, VA, V; what is not known is left
        out.
        """
        (v_d, v_q), (i_d, i_q) = self.v0, self.i0
        named = {
            "v0_D": v_d,
            "v0_Q": v_q,
            "i0_D": i_d,
            "i0_Q": i_q,
            "p_pcc": self.p_pcc,
            "q_pcc": self.q_pcc,
        }
        named |= {"omega_0": self.omega_0, "s_base_va": self.s_base_va, "v_base_v": self.v_base_v}
        return {
            name: float(value)
            for name, value in named.items()
            if value is not None and np.isfinite(value)
        }


@takes_kinds
def linear_model(record: Record, op: str | None = None) -> LinearModel:
    """The matrices of a record at an operating point.

    op : one of the record's, or "p=0.5,q=0[,v=1]" anywhere else, in the record's power node (needs
    shared parameters
        and the exact equilibrium); None where the record has only one.

    Raises OperatingPointError for a point that is unknown, badly written or does not exist;
    IbridError for a record without a fit.
    """
    with whole_record():
        record, name = with_point(record, op)
        if not np.isfinite(record.response(name, np.array([record.settings["f0_hz"]]))).all():
            raise OperatingPointError(
                f"the model has no real operating point at {name}; ask for less power"
            )
        system = record.state_space(name)
        settings = record.settings
        point = record.point(name)
        try:
            v0, i0 = record.terminal_point(name)
        except (
            DiagramError
        ):  # a plant without a closed form, which only the paper's equilibrium admits
            v0 = i0 = (float("nan"), float("nan"))
        bases = settings.get("bases", {})
        return LinearModel(
            **{part: np.array(getattr(system, part), dtype=float) for part in "ABCD"},
            states=tuple(system.state_labels),
            inputs=tuple(system.input_labels),
            outputs=tuple(system.output_labels),
            name=str(system.name),
            op=name,
            p=point.p,
            q=point.q,
            v=point.v,
            power_node=settings["power_node"],
            f0_hz=float(settings["f0_hz"]),
            parameters=dict(record.parameters[name]),
            pade_orders=dict(settings.get("pade_orders", {})),
            v0=v0,
            i0=i0,
            s_base_va=bases.get("s_base_va"),
            v_base_v=bases.get("v_base_v"),
        )


@contextmanager
def whole_record() -> Iterator[None]:
    """What goes wrong inside because a record is incomplete or damaged, as one sentence."""
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise IbridError(
            f"the record is incomplete or damaged ({type(error).__name__}: {error}); make it again "
            "with ibrid evaluate"
        ) from error


def without_dust(model: LinearModel) -> LinearModel:
    """With zeros for coefficients that are rounding: below 1e-14 of their row, states in balanced
    units, and all of them together below 1e-12 of the response from 0.01 Hz to 100 kHz (to first
    order).
    """
    n, whole = len(model.A), np.block([[model.A, model.B], [model.C, model.D]])
    _, (scale, _) = matrix_balance(model.A, permute=False, separate=True)
    sizes = np.abs(whole) * np.append(scale, np.ones(len(model.inputs)))
    small = (whole != 0) & (sizes <= 1e-14 * sizes.max(axis=1, keepdims=True))
    states = np.linalg.inv(
        2j * np.pi * np.geomspace(1e-2, 1e5, 141)[:, None, None] * np.eye(n) - model.A
    )
    size = np.linalg.norm(model.C @ states @ model.B + model.D, axis=(1, 2), keepdims=True)
    from_voltage = np.pad(
        np.linalg.norm(states @ model.B, axis=2), ((0, 0), (0, 2)), constant_values=1.0
    )
    to_current = np.pad(
        np.linalg.norm(model.C @ states, axis=1), ((0, 0), (0, 2)), constant_values=1.0
    )
    moved = to_current[:, :, None] * np.abs(whole) * from_voltage[:, None, :]
    kept = np.where(small & (small.sum() * moved <= 1e-12 * size).all(axis=0), 0.0, whole)
    return replace(model, A=kept[:n, :n], B=kept[:n, n:], C=kept[n:, :n], D=kept[n:, n:])


def with_point(record: Record, op: str | None) -> tuple[Record, str]:
    """The record, with `op` among its operating points, and the name of that point; raises as
    `linear_model`.
    """
    known = record.parameters
    if record.outcome != "ok" or not known:
        raise IbridError(
            f"the record has no fit (outcome {record.outcome}: {'; '.join(record.reasons)}); fit "
            "again"
        )
    if op is None and len(known) == 1:
        return record, next(iter(known))
    if op is None:
        raise OperatingPointError(
            f"the record has {len(known)} operating points; choose one: {'; '.join(known)}"
        )
    if op in known:
        return record, op
    if "=" not in op:
        raise OperatingPointError(
            f"the record has no operating point {op!r}; {near(op, known)}, or write p=..,q=.."
        )
    wanted = operating_point(op)
    points = record.settings["operating_points"]
    for name in known:
        if all(float(points[name][key]) == getattr(wanted, key) for key in "pqv"):
            return record, name
    if record.settings["parameters"] != "shared" or record.settings["equilibrium"] != "exact":
        raise IbridError(
            f"{op} is not a point of the record, and only a record with shared parameters and the "
            "exact equilibrium "
            f"says what happens elsewhere; choose one of {'; '.join(known)}"
        )
    settings = {
        **record.settings,
        "operating_points": {**points, wanted.name: {key: getattr(wanted, key) for key in "pqv"}},
    }
    values = {**known, wanted.name: next(iter(known.values()))}
    return replace(record, settings=settings, parameters=values), wanted.name
