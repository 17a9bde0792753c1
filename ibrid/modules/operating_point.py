"""Memoryless blocks whose entries are the operating point: frame rotations, power, magnitude,
decoupling by the PLL.

R = [[c, s], [-s, c]] at the angle delta_eq, J = [[0, -1], [1, 0]]. With equilibria (E0d, 0), (I0d,
0) and V0 = (1, 0) these are the printed matrices of the paper; with the full operating point they
are the exact linearisation.
"""

from dataclasses import replace

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

APPENDIX = "paper, appendix A.5"


def _rot_v(frame, v_DQ_eq):
    c, s = frame
    d_eq, q_eq = c * v_DQ_eq[0] + s * v_DQ_eq[1], c * v_DQ_eq[1] - s * v_DQ_eq[0]
    return [], [], [[], []], [[c, s, q_eq], [-s, c, -d_eq]]


def _rot_v_law(x, v_DQ, delta):
    c, s = cosine(delta), sine(delta)
    return (), (c * v_DQ[0] + s * v_DQ[1], c * v_DQ[1] - s * v_DQ[0])


ROT_V = ModuleKind(
    name="Rot_v",
    family="operating point",
    law="v_dq = R v_DQ - J R V0 delta",
    inputs={"v_DQ": Signal.DQ_VEC, "delta": Signal.SCALAR},
    outputs={"v_dq": Signal.DQ_VEC},
    state_space=_rot_v,
    equilibrium={"v_DQ": "V0"},
    reference=APPENDIX,
    large_signal=LargeSignal(_rot_v_law, angle="delta"),
)


def _rot_i(frame, i_dq_eq):
    c, s = frame
    i_d, i_q = i_dq_eq
    return [], [], [[], []], [[c, -s, -(i_d * s + i_q * c)], [s, c, i_d * c - i_q * s]]


def _rot_i_law(x, i_dq, delta):
    c, s = cosine(delta), sine(delta)
    return (), (c * i_dq[0] - s * i_dq[1], s * i_dq[0] + c * i_dq[1])


ROT_I = ModuleKind(
    name="Rot_i",
    family="operating point",
    law="i_DQ = R' i_dq + R' J i_eq delta",
    inputs={"i_dq": Signal.DQ_VEC, "delta": Signal.SCALAR},
    outputs={"i_DQ": Signal.DQ_VEC},
    state_space=_rot_i,
    equilibrium={"i_dq": "I0d"},
    reference=APPENDIX,
    large_signal=LargeSignal(_rot_i_law, angle="delta"),
)


def _pq_calc(e_eq, i_eq):
    return (
        [],
        [],
        [[], []],
        [[i_eq[0], i_eq[1], e_eq[0], e_eq[1]], [-i_eq[1], i_eq[0], e_eq[1], -e_eq[0]]],
    )


def _pq_calc_law(x, e, i):
    return (), (dot(e, i), reactive(e, i))


PQ_CALC = ModuleKind(
    name="PQ_calc",
    family="operating point",
    law="p = e' i, q = e' J i, linearised about (e_eq, i_eq)",
    inputs={"e": Signal.DQ_VEC, "i": Signal.DQ_VEC},
    outputs={"p": Signal.SCALAR, "q": Signal.SCALAR},
    state_space=_pq_calc,
    equilibrium={"e": "E0d", "i": "I0d"},
    bilinear=True,
    reference=APPENDIX,
    large_signal=LargeSignal(_pq_calc_law),
)


def _j_mul_omega(L, omega_0, in__eq):
    return [], [], [[], []], [[0, -L, -L / omega_0 * in__eq[1]], [L, 0, L / omega_0 * in__eq[0]]]


def _j_mul_omega_law(x, in_, delta_omega, L, omega_0):
    reactance = L * (1 + delta_omega / omega_0)
    return (), (-reactance * in_[1], reactance * in_[0])


J_MUL_OMEGA = ModuleKind(
    name="JMul_omega",
    family="operating point",
    law="out = L J in_ + (L/omega_0) J in_eq delta_omega: decoupling that uses the PLL frequency, "
    "equation (6b)",
    inputs={"in_": Signal.DQ_VEC, "delta_omega": Signal.SCALAR},
    outputs={"out": Signal.DQ_VEC},
    parameters={"L": Range(1e-4, 1.0, 0.1, "pu", "coupling inductance")},
    state_space=_j_mul_omega,
    equilibrium={"in_": "I0d"},
    extended=True,
    reference="paper, equation (6b), linearised",
    large_signal=LargeSignal(_j_mul_omega_law),
)


def _share(share_p, share_q):
    return [], [], [[], []], [[1, 0], [0, 1]]


#: A device that takes power from the other, or delivers more than both together, is said to: its
#: binding has a box of its own.
_FRACTION = Range(
    -2.0,
    3.0,
    0.5,
    "1",
    "fraction that this device delivers, the rest is the other's; 0 to 1 without a box of its own",
    usual=(0.0, 1.0),
)

SHARE = ModuleKind(
    name="Share",
    family="operating point",
    law="v = v_DQ, the terminal voltage of one of two devices behind one PCC: of their p and q it "
    "delivers the fractions "
    "share_p and share_q, the device without a Share the rest",
    inputs={"v_DQ": Signal.DQ_VEC},
    outputs={"v": Signal.DQ_VEC},
    parameters={
        "share_p": replace(_FRACTION, meaning=f"of p the {_FRACTION.meaning}"),
        "share_q": replace(_FRACTION, meaning=f"of q the {_FRACTION.meaning}"),
    },
    state_space=_share,
    shares=("share_p", "share_q"),
    extended=True,
    reference="currents at a common PCC add up",
)


def _magnitude(in__eq):
    size = dot(in__eq, in__eq) ** 0.5
    return [], [], [[]], [[in__eq[0] / size, in__eq[1] / size]]


def _magnitude_law(x, in_):
    return (), (length(in_),)


MAGNITUDE = ModuleKind(
    name="Magnitude",
    family="operating point",
    law="out = |in_|, linearised: in_eq' in_ / |in_eq|",
    inputs={"in_": Signal.DQ_VEC},
    outputs={"out": Signal.SCALAR},
    state_space=_magnitude,
    equilibrium={"in_": "E0d"},
    extended=True,
    reference="AC-voltage control; the d component where the frame lies on the vector",
    large_signal=LargeSignal(_magnitude_law),
)


def _ref_pq(v_eq, i_eq):
    scale = reciprocal(dot(v_eq, v_eq))
    rows = [[-scale * i * v_eq[0], -scale * i * v_eq[1], 0, 0] for i in i_eq]
    return [], [], [[], []], rows


def _ref_pq_law(x, v, i, v_eq, i_eq):
    size = square_root(dot(v_eq, v_eq) * reciprocal(dot(v, v)))
    return (), (size * i_eq[0], size * i_eq[1])


REF_PQ = ModuleKind(
    name="Ref_pq",
    family="operating point",
    law="out = (p*/|v|, -q*/|v|): a current reference from set-points of power and the measured "
    "voltage, filtered or not; the "
    "set-points are those that let the controlled current i rest, p* = |v_eq| i_d_eq, q* = -|v_eq| "
    "i_q_eq",
    inputs={"v": Signal.DQ_VEC, "i": Signal.DQ_VEC},
    outputs={"out": Signal.DQ_VEC},
    state_space=_ref_pq,
    equilibrium={"v": "E0d", "i": "I0d"},
    rests_by_law=True,
    extended=True,
    reference="open-loop power control: A. Yazdani and R. Iravani, Voltage-Sourced Converters in "
    "Power Systems (2010), 8.3",
    large_signal=LargeSignal(_ref_pq_law),
)
