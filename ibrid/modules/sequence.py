"""Filters and controllers that tell positive from negative sequence: SOGI, DSOGI, double
synchronous frame, resonators.

In a frame that turns at omega a stationary quantity at the fundamental rests and its negative
sequence turns at -2 omega. Most filters are tuned to the speed of the frame in which they work:
behind a rotation into the controller's frame that is the measured frequency (adaptive tuning, whose
terms in delta_omega cancel at rest), on v_DQ the nominal one. The `_fixed` ones stay tuned to the
nominal frequency in a frame that does not. Complex gains lead from in_d + j in_q to out_d + j
out_q, w = omega_0.
"""

from collections.abc import Callable
from dataclasses import replace
from math import pi

from ibrid.modules.control import PI_DQ, cutoff
from ibrid.modules.kind import Matrices, ModuleKind, Range
from ibrid.modules.large_signal import LargeSignal, Motion
from ibrid.signals import Signal

DQ = {"in_": Signal.DQ_VEC}, {"out": Signal.DQ_VEC}
_STATES = ("y_d", "y_q", "z_d", "z_q")
_K = Range(1e-3, 20.0, 1.41, "1", "gain of the SOGI, twice its damping", divides=True)


def _sogi_motion(k, omega_0):
    w, b = omega_0, k * omega_0
    a = [[-b, w, -w, 0], [-w, -b, 0, -w], [w, 0, 0, w], [0, w, -w, 0]]
    return a, [[b, 0], [0, b], [0, 0], [0, 0]]


def _sogi(k, omega_0):
    return *_sogi_motion(k, omega_0), [[1, 0, 0, 0], [0, 1, 0, 0]], [[0, 0], [0, 0]]


def _dsogi(k, omega_0):
    return *_sogi_motion(k, omega_0), [[0.5, 0, 0, -0.5], [0, 0.5, 0.5, 0]], [[0, 0], [0, 0]]


SOGI_DQ = ModuleKind(
    name="SOGI_dq",
    family="dynamic control",
    law="stationary frame, both axes: y' = k omega_0 (in_ - y) - omega_0 z, z' = omega_0 y; in dq "
    "also - omega_0 J y and "
    "- omega_0 J z; out = y, a band-pass at the fundamental: k w (s + j w)/((s + j w)^2 + k w (s + "
    "j w) + w^2)",
    inputs=DQ[0],
    outputs=DQ[1],
    states=_STATES,
    parameters={"k": _K},
    state_space=_sogi,
    dc_gain=1.0,
    extended=True,
    reference="second-order generalised integrator: M. Ciobotaru, R. Teodorescu and F. Blaabjerg, "
    "PESC 2006",
)

DSOGI_DQ = replace(
    SOGI_DQ,
    name="DSOGI_dq",
    law="y, z as in SOGI_dq; out = (y + J z)/2, the positive sequence: (k w/2)(s + 2 j w)/((s + j "
    "w)^2 + k w (s + j w) + w^2)",
    state_space=_dsogi,
    reference="dual SOGI: P. Rodriguez, R. Teodorescu, I. Candela, A. V. Timbus, M. Liserre and F. "
    "Blaabjerg, PESC 2006",
)


def _fixed_motion(k, omega_0, in__eq):
    # y rests at in_, z at -J in_; the frame's deviation turns both
    a, b = _sogi_motion(k, omega_0)
    d, q = in__eq
    return a, [[*row, turned] for row, turned in zip(b, (q, -d, -d, -q), strict=True)]


def _sogi_fixed(k, omega_0, in__eq):
    return *_fixed_motion(k, omega_0, in__eq), [[1, 0, 0, 0], [0, 1, 0, 0]], [[0, 0, 0], [0, 0, 0]]


def _dsogi_fixed(k, omega_0, in__eq):
    return (
        *_fixed_motion(k, omega_0, in__eq),
        [[0.5, 0, 0, -0.5], [0, 0.5, 0.5, 0]],
        [[0, 0, 0], [0, 0, 0]],
    )


def _fixed_rates(x, in_, delta_omega, k, omega_0):
    (y_d, y_q, z_d, z_q), w, omega = x, omega_0, omega_0 + delta_omega
    return (
        k * w * (in_[0] - y_d) - w * z_d + omega * y_q,
        k * w * (in_[1] - y_q) - w * z_q - omega * y_d,
        w * y_d + omega * z_q,
        w * y_q - omega * z_d,
    )


def _sogi_fixed_law(x, in_, delta_omega, k, omega_0):
    return _fixed_rates(x, in_, delta_omega, k, omega_0), x[:2]


def _dsogi_fixed_law(x, in_, delta_omega, k, omega_0):
    return _fixed_rates(x, in_, delta_omega, k, omega_0), (0.5 * (x[0] - x[3]), 0.5 * (x[1] + x[2]))


def _fixed_at_rest(in__eq):
    return in__eq[0], in__eq[1], in__eq[1], -in__eq[0]


def _fixed(
    kind: ModuleKind, name: str, state_space: Callable[..., Matrices], law: Callable[..., Motion]
) -> ModuleKind:
    return replace(
        kind,
        name=name,
        law=f"{kind.law}; also - J y_eq delta_omega and - J z_eq delta_omega of a frame whose "
        "frequency it does not follow",
        inputs={**DQ[0], "delta_omega": Signal.SCALAR},
        state_space=state_space,
        equilibrium={"in_": "E0d"},
        large_signal=LargeSignal(law, _fixed_at_rest),
    )


SOGI_FIXED = _fixed(SOGI_DQ, "SOGI_fixed", _sogi_fixed, _sogi_fixed_law)
DSOGI_FIXED = _fixed(DSOGI_DQ, "DSOGI_fixed", _dsogi_fixed, _dsogi_fixed_law)


def _ddsrf(omega_c, omega_0):
    g, w = omega_c, 2 * omega_0
    a = [[-g, 0, -g, 0], [0, -g, 0, -g], [-g, 0, -g, w], [0, -g, -w, -g]]
    return a, [[g, 0], [0, g], [g, 0], [0, g]], [[0, 0, -1, 0], [0, 0, 0, -1]], [[1, 0], [0, 1]]


DDSRF_DQ = ModuleKind(
    name="DDSRF_dq",
    family="dynamic control",
    law="p' = omega_c (in_ - p - m), m' = omega_c (in_ - p - m) - 2 omega_0 J m, out = in_ - m: "
    "positive and negative sequence "
    "p, m decoupled from each other; an LPF1_dq of the same omega_c behind it gives p",
    inputs=DQ[0],
    outputs=DQ[1],
    states=("p_d", "p_q", "m_d", "m_q"),
    parameters={"omega_c": cutoff(40.0)},
    state_space=_ddsrf,
    dc_gain=1.0,
    extended=True,
    reference="decoupled double synchronous reference frame: P. Rodriguez, J. Pou, J. Bergas, J. "
    "I. Candela, R. P. Burgos and "
    "D. Boroyevich, IEEE TPEL 22 (2007)",
)


def _resonant(k, omega_c, n, omega_0):
    b, w = 2 * omega_c, n * omega_0
    a = [[-b, 0, -w, 0], [0, -b, 0, -w], [w, 0, 0, 0], [0, w, 0, 0]]
    return a, [[b, 0], [0, b], [0, 0], [0, 0]], [[k, 0, 0, 0], [0, k, 0, 0]], [[0, 0], [0, 0]]


RESONANT_DQ = ModuleKind(
    name="Resonant_dq",
    family="dynamic control",
    law="out = k 2 omega_c s/(s^2 + 2 omega_c s + (n omega_0)^2) in_ on each axis; in dq n = 2 is "
    "the negative sequence of "
    "the fundamental, n = 6 its 5th and 7th harmonic",
    inputs=DQ[0],
    outputs=DQ[1],
    states=("band_d", "band_q", "quadrature_d", "quadrature_q"),
    parameters={
        "k": Range(1e-4, 1e3, 1.0, "1", "gain at the resonance"),
        "omega_c": Range(
            2 * pi * 1e-3, 2 * pi * 100, 2 * pi, "rad/s", "half of the bandwidth", divides=True
        ),
        "n": Range(0.5, 60.0, 2.0, "1", "multiple of the nominal frequency", divides=True),
    },
    state_space=_resonant,
    dc_gain=0.0,
    extended=True,
    reference="proportional-resonant control: R. Teodorescu, F. Blaabjerg, M. Liserre and P. C. "
    "Loh, IEE Proc. EPA 153 (2006)",
)


def _pi_negative(kP, kI, omega_0):
    w = 2 * omega_0
    return [[0, w], [-w, 0]], [[1, 0], [0, 1]], [[kI, 0], [0, kI]], [[kP, 0], [0, kP]]


PI_NEGATIVE_DQ = replace(
    PI_DQ,
    name="PI_negative_dq",
    law="out = kP in_ + kI x, x' = in_ - 2 omega_0 J x: a PI controller in the frame that turns "
    "backwards, where the negative sequence rests; seen from the forward frame kP + kI/(s + 2 j w)",
    state_space=_pi_negative,
    extended=True,
    reference="dual current control: H.-S. Song and K. Nam, IEEE TIE 46 (1999); R. Teodorescu, M. "
    "Liserre and P. Rodriguez, Grid Converters for Photovoltaic and Wind Power Systems (2011), "
    "chapters 8 to 10",
)
