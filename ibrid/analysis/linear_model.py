"""What every export starts from: the matrices of a record at one operating point, their names and what they mean."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from ibrid.errors import IbridError, OperatingPointError, near
from ibrid.evaluation.record import Record
from ibrid.plants.sweeping import operating_point

UNITS = (
    "per unit on the inverter's base, time in s: dx/dt = A x + B [v_D, v_Q], [i_D, i_Q] = C x + D [v_D, v_Q]; small "
    "deviations, current out of the inverter, q axis leading d"
)


@dataclass(frozen=True, eq=False)
class LinearModel:
    """dx/dt = A x + B v_DQ, i_DQ = C x + D v_DQ, per unit, current out, q leading.

    `states` : "instance.state". `op` : name of the operating point; `p`, `q`, `v` : per unit, measured at `power_node`.
    `f0_hz` : nominal frequency. `parameters` : free name -> value. `pade_orders` : of the delays, instance -> order.
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


def linear_model(record: Record, op: str | None = None) -> LinearModel:
    """The matrices of a record at an operating point.

    op : one of the record's, or "p=0.5,q=0[,v=1]" anywhere else, in the record's power node (needs shared parameters
        and the exact equilibrium); None where the record has only one.

    Raises OperatingPointError for a point that is unknown, badly written or does not exist; IbridError for a record
    without a fit.
    """
    with whole_record():
        return _linear_model(*with_point(record, op))


@contextmanager
def whole_record() -> Iterator[None]:
    """What goes wrong inside because a record is incomplete or damaged, as one sentence."""
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise IbridError(
            f"the record is incomplete or damaged ({type(error).__name__}: {error}); make it again with ibrid evaluate"
        ) from error


def _linear_model(record: Record, name: str) -> LinearModel:
    if not np.isfinite(record.response(name, np.array([record.settings["f0_hz"]]))).all():
        raise OperatingPointError(f"the model has no real operating point at {name}; ask for less power")
    system = record.state_space(name)
    point = record.settings["operating_points"][name]
    return LinearModel(
        **{part: np.array(getattr(system, part), dtype=float) for part in "ABCD"},
        states=tuple(system.state_labels),
        inputs=tuple(system.input_labels),
        outputs=tuple(system.output_labels),
        name=str(system.name),
        op=name,
        p=float(point["p"]),
        q=float(point["q"]),
        v=float(point["v"]),
        power_node=record.settings["power_node"],
        f0_hz=float(record.settings["f0_hz"]),
        parameters=dict(record.parameters[name]),
        pade_orders=dict(record.settings.get("pade_orders", {})),
    )


def with_point(record: Record, op: str | None) -> tuple[Record, str]:
    """The record, with `op` among its operating points, and the name of that point; raises as `linear_model`."""
    known = record.parameters
    if record.outcome != "ok" or not known:
        raise IbridError(
            f"the record has no fit (outcome {record.outcome}: {'; '.join(record.reasons)}); evaluate again"
        )
    if op is None and len(known) == 1:
        return record, next(iter(known))
    if op is None:
        raise OperatingPointError(f"the record has {len(known)} operating points; choose one: {'; '.join(known)}")
    if op in known:
        return record, op
    if "=" not in op:
        raise OperatingPointError(f"the record has no operating point {op!r}; {near(op, known)}, or write p=..,q=..")
    wanted = operating_point(op)
    points = record.settings["operating_points"]
    for name in known:
        if all(float(points[name][key]) == getattr(wanted, key) for key in "pqv"):
            return record, name
    if record.settings["parameters"] != "shared" or record.settings["equilibrium"] != "exact":
        raise IbridError(
            f"{op} is not a point of the record, and only a record with shared parameters and the exact equilibrium "
            f"says what happens elsewhere; choose one of {'; '.join(known)}"
        )
    settings = {
        **record.settings,
        "operating_points": {**points, wanted.name: {key: getattr(wanted, key) for key in "pqv"}},
    }
    values = {**known, wanted.name: next(iter(known.values()))}
    return replace(record, settings=settings, parameters=values), wanted.name
