"""Hide effects in a device: choose them, draw a device that can have them, and draw again until it
is stable.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from ibrid_bench.hidden.bases import BASES, draw_base
from ibrid_bench.hidden.declaration import Fields, HiddenEffect, Severity, changed, drawn
from ibrid_bench.hidden.device import stable
from ibrid_bench.hidden.parameters import Device
from ibrid_bench.hidden.written import Measurement

from ibrid.errors import IbridError, near
from ibrid.measurement.sweeps.sweep import OperatingPoint, PowerNode

_ATTEMPTS = 1000


@dataclass(frozen=True, eq=False)
class Hiding:
    """A device, the model that does not know what it hides, and how its sweep is written.

    effects : each with its numbers, in the device, or in the model where the device lacks it. base
    : name of the
    structure before. power_node : where p and q are measured; the PCC as soon as device or model
    has no capacitor.
    """

    device: Device
    model: Device
    measurement: Measurement
    effects: tuple[tuple[HiddenEffect, dict[str, float]], ...]
    base: str
    power_node: PowerNode


def choose(
    pool: Sequence[HiddenEffect], wanted: Sequence[str], count: int, rng: np.random.Generator
) -> tuple[HiddenEffect, ...]:
    """`count` effects of the pool that can be hidden together: the wanted ones ("id", "id:change"
    or the whole key), the rest at random.

    Raises IbridError for an unknown name, more than `count`, and effects that do not go together.
    """
    if len(wanted) > count:
        raise IbridError(
            f"this kind of case hides {count} effects; found {len(wanted)}, choose another kind."
        )
    sets = [_called(name, pool) for name in wanted]
    # a partner that nobody asked for is one that can be named beside another
    sets += [
        tuple(one for one in pool if one.verdicts[0] == "named") if count > 1 else tuple(pool)
    ] * (count - len(wanted))
    chosen: tuple[HiddenEffect, ...] = ()
    for candidates in sets:
        fitting = [one for one in candidates if all(_go_together(one, other) for other in chosen)]
        if not fitting:
            names = ", ".join(one.key for one in chosen)
            raise IbridError(
                f"{candidates[0].id} cannot be hidden beside {names}; choose another pair."
            )
        chosen += (fitting[int(rng.integers(len(fitting)))],)
    return chosen


def hide(
    effects: Sequence[HiddenEffect],
    severity: Severity,
    ops: Sequence[OperatingPoint],
    omega_0: float,
    rng: np.random.Generator,
) -> Hiding:
    """A random device with these effects that is stable at the operating points.

    Raises IbridError when there is no structure that can have them, or none of many draws is
    stable.
    """
    names = [name for name in BASES if all(effect.fits(draw_base(name, rng)) for effect in effects)]
    keys = " and ".join(effect.key for effect in effects) or "nothing"
    if not names:
        raise IbridError(f"no structure can hide {keys}; choose other effects.")
    for _ in range(_ATTEMPTS):
        name = names[int(rng.integers(len(names)))]
        found = _draw(name, effects, severity, rng)
        if found is not None and all(
            stable(found.device, op, omega_0, power_node=found.power_node) for op in ops
        ):
            return found
    raise IbridError(
        f"none of {_ATTEMPTS} devices that hide {keys} ({severity}) is stable; choose a milder "
        "severity."
    )


def _called(name: str, pool: Sequence[HiddenEffect]) -> tuple[HiddenEffect, ...]:
    found = tuple(one for one in pool if f"{one.key}:".startswith(f"{name}:"))
    if not found:
        raise IbridError(
            f"{name} cannot be hidden in this kind of case; {near(name, [one.id for one in pool])}"
        )
    return found


def _go_together(one: HiddenEffect, other: HiddenEffect) -> bool:
    return one.id != other.id and one.together_with(other)


def _draw(
    name: str, effects: Sequence[HiddenEffect], severity: Severity, rng: np.random.Generator
) -> Hiding | None:
    """One draw; None where the parts do not make a device."""
    base = draw_base(name, rng)
    for_device: dict[str, Any] = {}
    for_model: dict[str, Any] = {}
    written: dict[str, Any] = {}
    told: list[tuple[HiddenEffect, dict[str, float]]] = []
    for effect in effects:
        both, own, model, measurement = (
            drawn(fields, severity, base, rng)
            for fields in (effect.both, effect.device, effect.model, effect.measurement)
        )
        for_device |= {**both, **own}
        for_model |= {**both, **model}
        written |= measurement
        told.append(
            (
                effect,
                _numbers({**both, **(model if effect.change == "remove" else own), **measurement}),
            )
        )
    try:
        device, model = changed(base, for_device), changed(base, for_model)
    except IbridError:
        return None
    node: PowerNode = "capacitor" if device.filter == model.filter == "LCL" else "pcc"
    return Hiding(device, model, Measurement(**written), tuple(told), name, node)


def _numbers(settings: Fields) -> dict[str, float]:
    return {
        name: float(value) for name, value in settings.items() if isinstance(value, float | int)
    }
