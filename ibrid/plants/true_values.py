"""True values of the textbook diagrams of grid-forming, hybrid and parallel inverters, from the nonlinear models.

Keyed "instance.parameter"; per unit, 1/s and rad/s. Signs and weights that an engineer writes into an equation are part of
a gain in the diagram.
"""

from ibrid.plants.gfm import DroopParameters, GFMParameters, OscillatorParameters, VSMParameters
from ibrid.plants.hybrid import HybridParameters
from ibrid.plants.output_filter import FilterParameters
from ibrid.plants.parallel import ParallelParameters
from ibrid.plants.true_program import true_values


def _filter(m: FilterParameters) -> dict[str, float]:
    return {f"plant.{name}": getattr(m, name) for name in ("L_F", "R_F", "C_F", "L_g", "R_g")}


def _cascade(m: GFMParameters) -> dict[str, float]:
    return {
        **_filter(m),
        "voltage.kP": m.kP_voltage,
        "voltage.kI": m.kI_voltage,
        "e_decoupling.L": m.C_F,
        "current.kP": m.kP_current,
        "current.kI": m.kI_current,
        "decoupling.L": m.L_F,
        "damping.k": -m.k_damping,
        "damping_filter.omega_c": m.omega_damping,
    }


def droop_values(m: DroopParameters, omega_0: float) -> dict[str, float]:
    """Of `gfm_droop`."""
    return {
        **_cascade(m),
        "p_filter.omega_c": m.omega_p,
        "p_droop.k": -m.m_p,
        "q_filter.omega_c": m.omega_q,
        "q_droop.k": -m.m_q,
        "virtual_reactance.L": m.X_virtual,
    }


def vsm_values(m: VSMParameters, omega_0: float) -> dict[str, float]:
    """Of `gfm_vsm`, whose swing equation is a low-pass of power and measured frequency, each with its gain."""
    damping = m.k_d + m.k_w
    return {
        **_cascade(m),
        "p_gain.k": -omega_0 / damping,
        "pll.kP_pll": m.kP_pll,
        "pll.kI_pll": m.kI_pll,
        "pll_damping.k": m.k_d / damping,
        "inertia.omega_c": damping / m.T_a,
        "q_filter.omega_c": m.omega_q,
        "q_droop.k": -m.m_q,
        "virtual_reactance.L": m.X_virtual,
    }


def oscillator_values(m: OscillatorParameters, omega_0: float) -> dict[str, float]:
    """Of `gfm_dvoc`."""
    return {
        **_cascade(m),
        "oscillator.eta": m.eta,
        "oscillator.kappa": m.kappa,
        "oscillator.alpha": m.alpha,
    }


def hybrid_values(m: HybridParameters, omega_0: float) -> dict[str, float]:
    """Of `hybrid_gfl_gfm`: the weights are within the gains of the PLL and the droop."""
    return {
        **_filter(m),
        "power_filter.omega_c": m.omega_c_power,
        "pll.kP": m.weight * m.kP_pll,
        "pll.kI": m.weight * m.kI_pll,
        "p_droop.k": -(1 - m.weight) * m.m_p,
        "power.kP": m.kP_power,
        "power.kI": m.kI_power,
        "current.kP": m.kP_current,
        "current.kI": m.kI_current,
        "decoupling.L": m.L_F,
    }


def parallel_values(m: ParallelParameters, omega_0: float) -> dict[str, float]:
    """Of `parallel_gfl_gfm`: those of `gfl_l_filter` and `gfm_droop`, each with its prefix, and the shares."""
    return {
        "gfl_share.share_p": m.share_p,
        "gfl_share.share_q": m.share_q,
        **{f"gfl_{name}": value for name, value in true_values(m.following, omega_0).items()},
        **{f"gfm_{name}": value for name, value in droop_values(m.forming, omega_0).items()},
    }
