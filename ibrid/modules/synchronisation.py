"""Synchronisation: the phase-locked loop that turns a quadrature voltage into frequency and angle deviations."""

from ibrid.modules.control import integral, proportional
from ibrid.modules.kind import ModuleKind
from ibrid.signals import Signal


def _srf_pll(kP_pll, kI_pll):
    a = [[0, 0], [kI_pll, 0]]
    b = [[1], [kP_pll]]
    c = [[kI_pll, 0], [0, 1]]
    d = [[kP_pll], [0]]
    return a, b, c, d


SRF_PLL = ModuleKind(
    name="SRF_PLL",
    family="synchronisation",
    law="delta_omega = (kP_pll + kI_pll/s) e_q in rad/s; delta = delta_omega/s in rad",
    inputs={"e_q": Signal.SCALAR},
    outputs={"delta_omega": Signal.SCALAR, "delta": Signal.SCALAR},
    states=("integral", "angle"),
    parameters={"kP_pll": proportional(60.0), "kI_pll": integral(1500.0)},
    state_space=_srf_pll,
    reference="paper, appendix A.4 and equation (3)",
)
