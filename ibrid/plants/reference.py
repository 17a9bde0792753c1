"""A reference inverter: named parameters with their source, its equilibrium and its true parameter values."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from math import pi
from types import MappingProxyType

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.measurement.sweep import OperatingPoint, PowerNode
from ibrid.plants.equilibrium import gfl_equilibrium
from ibrid.plants.gfl import Dynamics, GFLParameters, gfl_dynamics
from ibrid.plants.true_program import true_program, true_values

P1_Q03 = (OperatingPoint("p=1,q=0.3", 1.0, 0.3), OperatingPoint("p=1,q=-0.3", 1.0, -0.3))

# parameter of the block diagram -> field of GFLParameters; units agree
DIAGRAM_FIELDS: Mapping[str, str] = MappingProxyType(
    {
        "plant.L_F": "L_F",
        "plant.R_F": "R_F",
        "plant.C_F": "C_F",
        "plant.L_g": "L_g",
        "plant.R_g": "R_g",
        "pll.kP_pll": "kP_pll",
        "pll.kI_pll": "kI_pll",
        "pll_filter.omega_c": "omega_c_pll",
        "power.kP": "kP_power",
        "power.kI": "kI_power",
        "power_filter.omega_c": "omega_c_power",
        "current.kP": "kP_current",
        "current.kI": "kI_current",
        "decoupling.L": "L_decoupling",
        "feedforward.k": "feedforward",
    }
)


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
    parameters: GFLParameters
    f0_hz: float
    summary: str
    source: str
    operating_points: tuple[OperatingPoint, ...] = P1_Q03
    s_base_va: float | None = None
    v_base_v: float | None = None

    @property
    def omega_0(self) -> float:
        """Nominal angular frequency, rad/s."""
        return 2 * pi * self.f0_hz

    @property
    def power_node(self) -> PowerNode:
        """Where p and q are measured: the capacitor, or the PCC with an L filter."""
        return "capacitor" if self.parameters.filter == "LCL" else "pcc"

    @cached_property
    def program(self) -> str:
        """Program text of the block diagram that is exactly this inverter, linearised."""
        return true_program(self.parameters)

    @cached_property
    def diagram_values(self) -> Mapping[str, float]:
        """True values of the parameters of `program`, keyed "instance.parameter"."""
        return MappingProxyType(true_values(self.parameters, self.omega_0))

    @property
    def dynamics(self) -> Dynamics:
        """The nonlinear model; built once per set of parameters."""
        return _dynamics(self.parameters, self.omega_0)

    def equilibrium(self, op: OperatingPoint) -> np.ndarray:
        """(n,) the state at which nothing moves; OperatingPointError when there is none."""
        return gfl_equilibrium(self.parameters, self.dynamics, op, self.omega_0)

    def with_overrides(self, overrides: Mapping[str, float | str]) -> "ReferenceInverter":
        """The inverter with other values, named as in the diagram ("plant.L_F") or as fields ("L_F", "decoupling").

        Raises IbridError with the near names when a name is unknown or a value has the wrong kind.
        """
        if not overrides:
            return self
        own = {field.name for field in fields(GFLParameters)}
        known = own | set(DIAGRAM_FIELDS) | {"f0_hz"}
        values: dict[str, float | str] = {}
        for name, value in overrides.items():
            if name not in known:
                raise IbridError(f"{self.name} has no parameter {name}; {near(name, known)}")
            values[DIAGRAM_FIELDS.get(name, name)] = _converted(name, value)
        f0_hz = float(values.pop("f0_hz", self.f0_hz))
        if f0_hz <= 0:
            raise IbridError(f"f0_hz must be positive; found {f0_hz:g}.")
        told = ", ".join(f"{name} = {value}" for name, value in overrides.items())
        return replace(
            self,
            parameters=replace(self.parameters, **values),  # type: ignore[arg-type]
            f0_hz=f0_hz,
            source=f"{self.source} Changed: {told}.",
        )


_WORDS = {"decoupling": ("pll", "nominal", "none"), "filter": ("LCL", "L")}


def _converted(name: str, value: float | str) -> float | str:
    if name in _WORDS:
        if value not in _WORDS[name]:
            raise IbridError(f"{name} must be one of {', '.join(_WORDS[name])}; found {value}.")
        return value
    try:
        return float(value)
    except ValueError:
        raise IbridError(f"{name} must be a number; found {value}.") from None


@cache
def _dynamics(parameters: GFLParameters, omega_0: float) -> Dynamics:
    return gfl_dynamics(parameters, omega_0)
