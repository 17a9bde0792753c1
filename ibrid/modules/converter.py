"""The converter between command and filter, and how a sampled controller reaches it: dead time,
delay angle, hold.
"""

from ibrid.modules.branch import BRANCH
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.large_signal import (
    LargeSignal,
    cosine,
    dot,
    reciprocal,
    sine,
    square_root,
)
from ibrid.signals import Signal


def _dead_time(D, a, i_eq):
    d, q = i_eq
    square = d * d + q * q + a * a
    scale = D * reciprocal(square * square_root(square))
    cross = scale * d * q
    return [], [], [[], []], [[-scale * (q * q + a * a), cross], [cross, -scale * (d * d + a * a)]]


def _dead_time_law(x, i, D, a):
    scale = D * reciprocal(square_root(dot(i, i) + a * a))
    return (), (-scale * i[0], -scale * i[1])


DEAD_TIME = ModuleKind(
    name="DeadTime",
    family=BRANCH,
    law="out = -D i/sqrt(|i|^2 + a^2), linearised -(D/r)(I - i_eq i_eq'/r^2) i with r^2 = |i_eq|^2 "
    "+ a^2: the voltage that dead "
    "time takes from the command against the converter's current, smoothed by the ripple",
    inputs={"i": Signal.DQ_VEC},
    outputs={"out": Signal.DQ_VEC},
    parameters={
        "D": Range(
            1e-5,
            0.5,
            0.02,
            "pu",
            "lost voltage: 4/pi x dead time x switching frequency x V_dc/2 over the base",
        ),
        "a": Range(
            1e-3, 2.0, 0.1, "pu", "current at which the ripple smooths the sign", divides=True
        ),
    },
    state_space=_dead_time,
    equilibrium={"i": "I0d"},
    rests_by_law=True,
    extended=True,
    reference="averaged over the fundamental: S.-G. Jeong and M.-H. Park, IEEE TIE 38 (1991); "
    "smoothed by the ripple",
    large_signal=LargeSignal(_dead_time_law),
)


def _turn(phi):
    c, s = cosine(phi), sine(phi)
    return [], [], [[], []], [[c, -s], [s, c]]


TURN = ModuleKind(
    name="Turn",
    family="static",
    law="out = [[cos phi, -sin phi], [sin phi, cos phi]] in_: the part of the delay angle omega_0 "
    "T_d that a controller leaves "
    "uncompensated (phi < 0 where it compensates too little)",
    inputs={"in_": Signal.DQ_VEC},
    outputs={"out": Signal.DQ_VEC},
    parameters={"phi": Range(-1.0, 1.0, -0.05, "rad", "angle by which a vector is turned ahead")},
    state_space=_turn,
    extended=True,
    reference="exp(-s T_d) of the stationary frame, seen in a frame that turns at omega_0",
)


def _zero_order_hold(T_s):
    # of (1 - e^-z)/z, z = s T_s, with the Pade form of e^-z of order 5:
    # 2 (z^4 + 420 z^2 + 15120)/(z^5 + 30 z^4 + 420 z^3 + 3360 z^2 + 15120 z + 30240)
    r = 1 / T_s
    a = [[r if column == row + 2 else 0 for column in range(10)] for row in range(8)]
    for axis in (0, 1):
        a += [
            [
                -coefficient * r if one == axis else 0
                for coefficient in (30240, 15120, 3360, 420, 30)
                for one in (0, 1)
            ]
        ]
    c = [
        [
            coefficient if one == axis else 0
            for coefficient in (30240, 0, 840, 0, 2)
            for one in (0, 1)
        ]
        for axis in (0, 1)
    ]
    return a, [[0, 0]] * 8 + [[r, 0], [0, r]], c, [[0, 0], [0, 0]]


ZERO_ORDER_HOLD = ModuleKind(
    name="ZOH_dq",
    family="dynamic control",
    law="out = (1 - exp(-s T_s))/(s T_s) in_ on each axis, its Pade form of order 5, within 0.001 "
    "up to "
    "0.85/T_s and 0.004 up to 1/T_s; a sampled controller is a Delay of its computing time, then "
    "this",
    inputs={"in_": Signal.DQ_VEC},
    outputs={"out": Signal.DQ_VEC},
    states=tuple(f"held_{order}_{axis}" for order in range(1, 6) for axis in "dq"),
    parameters={"T_s": Range(1e-6, 2e-3, 1e-4, "s", "sampling period", divides=True)},
    state_space=_zero_order_hold,
    dc_gain=1.0,
    extended=True,
    reference="hold of a sampled controller and its modulator: S. Buso and P. Mattavelli, Digital "
    "Control in Power "
    "Electronics (2006)",
)
