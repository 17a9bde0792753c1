"""The families of reference inverters: for each class of parameters its equations, diagram, values
and names.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from types import MappingProxyType
from typing import Any

from ibrid.measurement.sweeps.sweep import OperatingPoint, PowerNode
from ibrid.plants.dynamics import Dynamics
from ibrid.plants.equilibrium import filter_at_rest
from ibrid.plants.gfl import GFLParameters, gfl_dynamics
from ibrid.plants.gfm import (
    DroopParameters,
    GFMParameters,
    OscillatorParameters,
    VSMParameters,
    gfm_dynamics,
)
from ibrid.plants.hybrid import HybridParameters, hybrid_dynamics
from ibrid.plants.parallel import ParallelParameters, parallel_dynamics
from ibrid.plants.true_program import true_program, true_values

#: Of a diagram, by the names of its parameters.
Values = dict[str, float]
#: Values of a diagram by name, from the parameters of an inverter and omega_0.
OfParameters = Callable[[Any, float], Values]


@dataclass(frozen=True)
class InverterFamily:
    """What a kind of inverter is, as functions of its parameters.

    dynamics : (parameters, omega_0 in rad/s) -> nonlinear model. program : parameters -> text of
    the diagram that equals it.
    values : (parameters, omega_0) -> true values of that diagram's parameters, keyed
    "instance.parameter".
    rest : (parameters, op) -> states near the steady state, by name.
    fields : parameter of the diagram -> field of the parameters, where the two are one number.
    words : field -> what it may be, for fields that are words.
    node : parameters -> where p and q are measured.
    """

    dynamics: Callable[[Any, float], Dynamics]
    program: Callable[[Any], str]
    values: OfParameters
    rest: Callable[[Any, OperatingPoint], Mapping[str, float]]
    fields: Mapping[str, str]
    words: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    node: Callable[[Any], PowerNode] = lambda m: "capacitor" if m.filter == "LCL" else "pcc"


def _gains(*loops: str) -> dict[str, str]:
    return {f"{loop}.{gain}": f"{gain}_{loop}" for loop in loops for gain in ("kP", "kI")}


_FILTER = {f"plant.{name}": name for name in ("L_F", "R_F", "C_F", "L_g", "R_g")}
_CASCADE = {**_FILTER, **_gains("voltage", "current"), "damping_filter.omega_c": "omega_damping"}
_DROOP = {**_CASCADE, "p_filter.omega_c": "omega_p", "q_filter.omega_c": "omega_q"}
_MACHINE = {
    **_CASCADE,
    "pll.kP_pll": "kP_pll",
    "pll.kI_pll": "kI_pll",
    "q_filter.omega_c": "omega_q",
}
_OSCILLATOR = {
    **_CASCADE,
    "oscillator.eta": "eta",
    "oscillator.kappa": "kappa",
    "oscillator.alpha": "alpha",
}
_HYBRID = {**_FILTER, "power_filter.omega_c": "omega_c_power", **_gains("power", "current")}
_SHARES = {"gfl_share.share_p": "share_p", "gfl_share.share_q": "share_q"}

_GFL_FIELDS = {
    **_FILTER,
    "pll.kP_pll": "kP_pll",
    "pll.kI_pll": "kI_pll",
    "pll_filter.omega_c": "omega_c_pll",
    **_gains("power", "current"),
    "power_filter.omega_c": "omega_c_power",
    "decoupling.L": "L_decoupling",
    "feedforward.k": "feedforward",
    "dc_link.C_dc": "C_dc",
    "dc_loop.kP": "kP_dc",
    "dc_loop.kI": "kI_dc",
    "ac_loop.kP": "kP_ac",
    "ac_loop.kI": "kI_ac",
}
_GFL_WORDS = {
    "decoupling": ("pll", "nominal", "none"),
    "filter": ("LCL", "L"),
    "p_loop": ("power", "dc_link"),
    "q_loop": ("power", "voltage"),
}


def _following(m: GFLParameters, op: OperatingPoint) -> Mapping[str, float]:
    found = filter_at_rest(m, op)
    return {
        **found,
        "pll.angle": found["angle"],
        "power_filter.p": op.p,
        "power_filter.q": op.q,
        "dc_link.v_dc": 1.0,
    }


def _forming(m: Any, op: OperatingPoint) -> Mapping[str, float]:
    found = filter_at_rest(m, op)
    return {**found, "angle.integral": found["angle"], "oscillator.E": found["plant.e_d"]}


def _both(m: ParallelParameters, op: OperatingPoint) -> Mapping[str, float]:
    """As if each delivered its share at its own node: near what it delivers at the PCC."""
    own = replace(op, p=m.share_p * op.p, q=m.share_q * op.q)
    rest = replace(op, p=op.p - own.p, q=op.q - own.q)
    found = {f"following.{name}": value for name, value in _following(m.following, own).items()}
    return found | {f"forming.{name}": value for name, value in _forming(m.forming, rest).items()}


def _values(fields: Mapping[str, str], others: OfParameters) -> OfParameters:
    """Values of a textbook diagram: fields as they are, and what follows from them."""
    return lambda m, omega_0: (
        {name: getattr(m, field) for name, field in fields.items()} | others(m, omega_0)
    )


def _of_cascade(m: GFMParameters, omega_0: float) -> Values:
    return {"e_decoupling.L": m.C_F, "decoupling.L": m.L_F, "damping.k": -m.k_damping}


def _of_droop(m: DroopParameters, omega_0: float) -> Values:
    droops = {"p_droop.k": -m.m_p, "q_droop.k": -m.m_q, "virtual_reactance.L": m.X_virtual}
    return _of_cascade(m, omega_0) | droops


def _of_machine(m: VSMParameters, omega_0: float) -> Values:
    """The swing equation is a low-pass of power and measured frequency, each with its gain."""
    damping = m.k_d + m.k_w
    return _of_cascade(m, omega_0) | {
        "p_gain.k": -omega_0 / damping,
        "pll_damping.k": m.k_d / damping,
        "inertia.omega_c": damping / m.T_a,
        "q_droop.k": -m.m_q,
        "virtual_reactance.L": m.X_virtual,
    }


def _of_hybrid(m: HybridParameters, omega_0: float) -> Values:
    """The weights are within the gains of the PLL and the droop."""
    pll = {"pll.kP": m.weight * m.kP_pll, "pll.kI": m.weight * m.kI_pll}
    return pll | {"p_droop.k": -(1 - m.weight) * m.m_p, "decoupling.L": m.L_F}


def _of_both(m: ParallelParameters, omega_0: float) -> Values:
    """Those of `gfl_l_filter` and `gfm_droop`, each with its prefix."""
    following, forming = (
        true_values(m.following, omega_0),
        _values(_DROOP, _of_droop)(m.forming, omega_0),
    )
    prefixed = {f"gfl_{name}": value for name, value in following.items()}
    return prefixed | {f"gfm_{name}": value for name, value in forming.items()}


def _textbook(
    name: str,
    fields: Mapping[str, str],
    others: OfParameters,
    dynamics: Callable[[Any, float], Dynamics] = gfm_dynamics,
    **differing: Any,
) -> InverterFamily:
    """A family whose program ships; read as text, for a truth for diagrams uses none of their
    code.
    """
    program = files("ibrid") / "structure" / "programs" / f"{name}.py"
    family = InverterFamily(
        dynamics,
        lambda m: program.read_text(encoding="utf-8"),
        _values(fields, others),
        _forming,
        fields,
    )
    return replace(family, **differing)


FAMILIES: Mapping[type, InverterFamily] = MappingProxyType(
    {
        GFLParameters: InverterFamily(
            gfl_dynamics, true_program, true_values, _following, _GFL_FIELDS, _GFL_WORDS
        ),
        DroopParameters: _textbook("gfm_droop", _DROOP, _of_droop),
        VSMParameters: _textbook("gfm_vsm", _MACHINE, _of_machine),
        OscillatorParameters: _textbook("gfm_dvoc", _OSCILLATOR, _of_cascade),
        HybridParameters: _textbook("hybrid_gfl_gfm", _HYBRID, _of_hybrid, hybrid_dynamics),
        ParallelParameters: _textbook(
            "parallel_gfl_gfm",
            _SHARES,
            _of_both,
            parallel_dynamics,
            rest=_both,
            node=lambda m: "pcc",
        ),
    }
)
