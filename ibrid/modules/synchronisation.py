"""Synchronisation: phase-locked loops that turn the frame, one that only measures in it, and a
virtual oscillator.
"""

from dataclasses import replace
from math import pi

from ibrid.modules.control import integral, proportional
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.large_signal import (
    LargeSignal,
    cosine,
    dot,
    length,
    reactive,
    reciprocal,
    sine,
    square_root,
)
from ibrid.signals import Signal

SYNCHRONISATION = "synchronisation"


#: Gains from the voltage on the q axis to the frequency; with v = 1 of a PLL without a filter
#: omega_n = sqrt(kI_pll) and damping kP_pll / (2 omega_n).
_KP = proportional(60.0, "rad/s/pu")
_KI = integral(1500.0, "rad/s^2/pu")


def _srf_pll(kP_pll, kI_pll):
    a = [[0, 0], [kI_pll, 0]]
    b = [[1], [kP_pll]]
    c = [[kI_pll, 0], [0, 1]]
    d = [[kP_pll], [0]]
    return a, b, c, d


SRF_PLL = ModuleKind(
    name="SRF_PLL",
    family=SYNCHRONISATION,
    law="delta_omega = (kP_pll + kI_pll/s) e_q in rad/s; delta = delta_omega/s in rad",
    inputs={"e_q": Signal.SCALAR},
    outputs={"delta_omega": Signal.SCALAR, "delta": Signal.SCALAR},
    states=("integral", "angle"),
    parameters={"kP_pll": _KP, "kI_pll": _KI},
    state_space=_srf_pll,
    reference="paper, appendix A.4 and equation (3)",
)


#: Of the voltage that a PLL leaves on its q axis. The d axis leads or lags by at most asin(0.8), 53
#: degrees, at a voltage of 1.
_ON_Q = Range(-0.8, 0.8, 0.05, "pu", "voltage on the q axis of the PLL at rest")


def _srf_pll_p(kP_pll, e_q_ref):
    return [[0]], [[kP_pll]], [[0], [1]], [[kP_pll], [0]]


def _beside_its_own_frequency(kP_pll, e_q_ref, deviation):
    return e_q_ref + deviation / kP_pll


SRF_PLL_P = replace(
    SRF_PLL,
    name="SRF_PLL_P",
    law="delta_omega = kP_pll (e_q - e_q_ref) in rad/s; delta = delta_omega/s in rad: a PLL "
    "without integral action, which rests "
    "with e_q = e_q_ref because the grid is faster than its own frequency by kP_pll e_q_ref",
    states=("angle",),
    parameters={"kP_pll": _KP, "e_q_ref": _ON_Q},
    state_space=_srf_pll_p,
    input_at_rest=_beside_its_own_frequency,
    extended=True,
    reference="F. M. Gardner, Phaselock Techniques (2005): the loop of first order and its static "
    "phase error",
)


def _srf_pll_ref(kP_pll, kI_pll, e_q_ref):
    return _srf_pll(kP_pll, kI_pll)


def _at_its_reference(e_q_ref, deviation):
    return e_q_ref


SRF_PLL_REF = replace(
    SRF_PLL,
    name="SRF_PLL_ref",
    law="delta_omega = (kP_pll + kI_pll/s) (e_q - e_q_ref) in rad/s; delta = delta_omega/s in rad: "
    "a PLL that controls the "
    "q axis to another voltage than zero",
    parameters={**SRF_PLL.parameters, "e_q_ref": _ON_Q},
    state_space=_srf_pll_ref,
    input_at_rest=_at_its_reference,
    extended=True,
    reference="paper, equation (3), with a reference of e_q",
)


def _pll_frequency(kP_pll, kI_pll, v_eq):
    size = length(v_eq)
    on_d, on_q = (
        -v_eq[1] * reciprocal(size),
        v_eq[0] * reciprocal(size),
    )  # of v, on the q axis of the PLL
    a = [[0, -size], [kI_pll, -kP_pll * size]]
    b = [[on_d, on_q, 0], [kP_pll * on_d, kP_pll * on_q, -1]]
    return a, b, [[kI_pll, -kP_pll * size]], [[kP_pll * on_d, kP_pll * on_q, 0]]


def _pll_frequency_law(x, v, delta_omega, kP_pll, kI_pll, v_eq):
    # the PLL's angle counts from v at rest, where its cosine and sine are v_eq / |v_eq|
    scale = reciprocal(length(v_eq))
    along = scale * dot(v_eq, v)
    across = scale * (v_eq[0] * v[1] - v_eq[1] * v[0])
    v_q = across * cosine(x[1]) - along * sine(x[1])
    omega = kP_pll * v_q + kI_pll * x[0]
    return (v_q, omega - delta_omega), (omega,)


def _locked_at_rest():
    return 0.0, 0.0


PLL_FREQUENCY = ModuleKind(
    name="PLL_frequency",
    family=SYNCHRONISATION,
    law="delta_omega_pll = (kP_pll + kI_pll/s) v_q, v_q of v in the PLL's own frame, whose angle "
    "in the controller frame "
    "is (delta_omega_pll - delta_omega)/s: the frequency of v, for a controller whose frame does "
    "not follow it",
    inputs={"v": Signal.DQ_VEC, "delta_omega": Signal.SCALAR},
    outputs={"delta_omega_pll": Signal.SCALAR},
    states=("integral", "angle"),
    parameters={"kP_pll": _KP, "kI_pll": _KI},
    state_space=_pll_frequency,
    equilibrium={"v": "E0d"},
    extended=True,
    reference="damping of a virtual synchronous machine: S. D'Arco, J. A. Suul and O. B. Fosso, "
    "EPSR 122 (2015)",
    large_signal=LargeSignal(_pll_frequency_law, _locked_at_rest),
)


def _dvoc(eta, kappa, alpha, v_eq, i_eq):
    square = dot(v_eq, v_eq)
    scale, c, s = reciprocal(square_root(square)), cosine(kappa), sine(kappa)
    p = [i_eq[0], i_eq[1], v_eq[0], v_eq[1]]
    q = [-i_eq[1], i_eq[0], v_eq[1], -v_eq[0]]
    on_omega = [
        eta * scale * scale * (c * of_q - s * of_p) for of_p, of_q in zip(p, q, strict=True)
    ]
    on_size = [-eta * scale * (c * of_p + s * of_q) for of_p, of_q in zip(p, q, strict=True)]
    return [[-2 * alpha * square]], [on_size], [[0], [1]], [on_omega, [0] * 4]


def _dvoc_law(x, v, i, eta, kappa, alpha, v_eq, i_eq):
    c, s, size, scale = cosine(kappa), sine(kappa), x[0], reciprocal(x[0])
    p = dot(v_eq, i_eq) - dot(v, i)
    q = reactive(v_eq, i_eq) - reactive(v, i)
    omega = eta * scale * scale * (s * p - c * q)
    square = dot(v_eq, v_eq)
    rate = eta * scale * (c * p + s * q) + alpha * (square - size * size) * size
    return (rate,), (omega, size)


def _dvoc_at_rest(v_eq):
    return (length(v_eq),)


DVOC = ModuleKind(
    name="dVOC",
    family=SYNCHRONISATION,
    law="delta_omega = eta/E^2 (sin(kappa) (p* - p) - cos(kappa) (q* - q)), "
    "E' = eta/E (cos(kappa) (p* - p) + sin(kappa) (q* - q)) + alpha (E*^2 - E^2) E, p = v' i, q = "
    "v' J i; set-points at "
    "rest; v takes the voltage that the controller makes equal to E on the d axis, E is its "
    "reference",
    inputs={"v": Signal.DQ_VEC, "i": Signal.DQ_VEC},
    outputs={"delta_omega": Signal.SCALAR, "E": Signal.SCALAR},
    states=("E",),
    parameters={
        "eta": Range(
            1e-3, 1e3, 1.5, "rad/s", "synchronisation gain, rad/s per unit of power at E = 1"
        ),
        "kappa": Range(
            0.0,
            pi,
            pi / 2,
            "rad",
            "rotation of the power error; pi/2 behind an inductive grid, 0 a resistive",
        ),
        "alpha": Range(1e-3, 1e4, 20.0, "1/s", "gain of the amplitude control"),
    },
    state_space=_dvoc,
    equilibrium={"v": "E0d", "i": "I0d"},
    extended=True,
    reference="dispatchable virtual oscillator control in polar form: G.-S. Seo, M. Colombino, I. "
    "Subotic, B. Johnson, "
    "D. Gross and F. Doerfler, APEC 2019",
    large_signal=LargeSignal(_dvoc_law, _dvoc_at_rest),
)
