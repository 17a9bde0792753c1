"""A reference inverter: named parameters with their source, its equilibrium and its true parameter
values.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, cached_property
from math import pi
from types import MappingProxyType
from typing import Any

import numpy as np

from ibrid.border import methods_take_kinds
from ibrid.errors import IbridError, near
from ibrid.measurement.sweeps.sweep import OperatingPoint, PowerNode
from ibrid.plants.dynamics import Dynamics
from ibrid.plants.equilibrium import AtRest, at_rest
from ibrid.plants.families import FAMILIES, InverterFamily
from ibrid.plants.gfl import GFLParameters
from ibrid.plants.gfm import GFMParameters
from ibrid.plants.hybrid import HybridParameters
from ibrid.plants.parallel import ParallelParameters
from ibrid.ranges import written_number

Parameters = GFLParameters | GFMParameters | HybridParameters | ParallelParameters

P1_Q03 = (OperatingPoint("p=1,q=0.3", 1.0, 0.3), OperatingPoint("p=1,q=-0.3", 1.0, -0.3))


@methods_take_kinds
@dataclass(frozen=True)
class ReferenceInverter:
    """An inverter whose inside is known.

    name : as in `ibrid sweep NAME`.
    parameters : per unit on its own base.
    f0_hz : nominal frequency, Hz.
    summary : one line.
    source : where the numbers come from, which were converted and which were chosen.
    operating_points : where it is swept by default.
    s_base_va, v_base_v : base of the per-unit values, where the source has one.
    """

    name: str
    parameters: Parameters
    f0_hz: float
    summary: str
    source: str
    operating_points: tuple[OperatingPoint, ...] = P1_Q03
    s_base_va: float | None = None
    v_base_v: float | None = None

    @property
    def family(self) -> InverterFamily:
        """What all inverters with such parameters have in common."""
        return FAMILIES[type(self.parameters)]

    @property
    def omega_0(self) -> float:
        """Nominal angular frequency, rad/s."""
        return 2 * pi * self.f0_hz

    @property
    def power_node(self) -> PowerNode:
        """Where p and q are measured: the capacitor, or the PCC with an L filter or of several
        inverters.
        """
        return self.family.node(self.parameters)

    @cached_property
    def program(self) -> str:
        """Program text of the block diagram that is exactly this inverter, linearised."""
        return self.family.program(self.parameters)

    @cached_property
    def diagram_values(self) -> Mapping[str, float]:
        """True values of the parameters of `program`, keyed "instance.parameter"."""
        return MappingProxyType(self.family.values(self.parameters, self.omega_0))

    @property
    def dynamics(self) -> Dynamics:
        """The nonlinear model; built once per set of parameters."""
        return _dynamics(self.parameters, self.omega_0)

    def at_rest(self, op: OperatingPoint) -> AtRest:
        """States and set-points at which nothing moves and p, q are those of `op`;
        OperatingPointError when there are none.
        """
        return at_rest(self.dynamics, self.family.rest(self.parameters, op), op)

    def equilibrium(self, op: OperatingPoint) -> np.ndarray:
        """(n,) the state at which nothing moves; OperatingPointError when there is none."""
        return self.at_rest(op).x

    def with_overrides(self, overrides: Mapping[str, float | str]) -> "ReferenceInverter":
        """The inverter with other values, named as in the diagram ("plant.L_F") or as fields
        ("L_F", "decoupling").

        Raises IbridError with the near names when a name is unknown, for a value of the wrong kind,
        and for one of a part that this inverter does not have (the capacitor of an L filter).
        """
        if not overrides:
            return self
        own = {
            field.name
            for field in fields(self.parameters)
            if not is_dataclass(getattr(self.parameters, field.name))
        }
        known = own | set(self.family.fields) | {"f0_hz"}
        values: dict[str, Any] = {}
        for name, value in overrides.items():
            if name not in known:
                raise IbridError(f"{self.name} has no parameter {name}; {near(name, known)}")
            values[self.family.fields.get(name, name)] = _converted(name, value, self.family.words)
        f0_hz = float(values.pop("f0_hz", self.f0_hz))
        if f0_hz <= 0:
            raise IbridError(f"f0_hz must be positive; found {f0_hz:g}.")
        told = ", ".join(f"{name} = {value}" for name, value in overrides.items())
        changed = replace(
            self,
            parameters=replace(self.parameters, **values),
            f0_hz=f0_hz,
            source=f"{self.source} Changed: {told}.",
        )
        for name in overrides:
            if changed._ignores(self.family.fields.get(name, name), self.parameters):
                raise IbridError(
                    f"{name} belongs to no part that {self.name} has, as it is set; leave it out."
                )
        return changed

    def _ignores(self, field: str, before: Parameters) -> bool:
        """True when the diagram is the same whether a field has its new value or the one before."""
        if (
            field == "f0_hz" or getattr(self.parameters, field) == 0
        ):  # 0 of what is not there is right
            return False
        try:
            parameters = replace(self.parameters, **{field: getattr(before, field)})
        except IbridError:  # the others need it
            return False
        other = replace(self, parameters=parameters)
        same = self.program == other.program and self.diagram_values == other.diagram_values
        return same and parameters != self.parameters


def _converted(name: str, value: float | str, words: Mapping[str, tuple[str, ...]]) -> float | str:
    if name in words:
        if value not in words[name]:
            raise IbridError(f"{name} must be one of {', '.join(words[name])}; found {value}.")
        return value
    try:
        return written_number(value) if isinstance(value, str) else float(value)
    except ValueError:
        raise IbridError(f"{name} must be a number; found {value}.") from None


@cache
def _dynamics(parameters: Parameters, omega_0: float) -> Dynamics:
    return FAMILIES[type(parameters)].dynamics(parameters, omega_0)
