"""Blocks that no designer draws: they absorb delay or an unmodelled resonance and are counted
apart.
"""

from math import pi

from ibrid.modules.control import on_each_axis
from ibrid.modules.kind import ModuleKind, Range
from ibrid.signals import Signal

APPENDIX = "paper, appendix A.7"
DELAY_TIME = Range(1e-6, 5e-3, 1e-4, "s", "delay", divides=True)


def _pade1(T_d):
    # (1 - T s/2)/(1 + T s/2) = -1 + 2/(1 + T s/2)
    return [[-2 / T_d]], [[2 / T_d]], [[2]], [[-1]]


def _pade1_dq(T_d):
    r = 2 / T_d
    return [[-r, 0], [0, -r]], [[r, 0], [0, r]], [[2, 0], [0, 2]], [[-1, 0], [0, -1]]


PADE1 = ModuleKind(
    name="Pade1",
    family="residual",
    law="out = (1 - T_d s/2)/(1 + T_d s/2) in_",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("lag",),
    parameters={"T_d": DELAY_TIME},
    state_space=_pade1,
    dc_gain=1.0,
    reference=APPENDIX,
)

PADE1_DQ = on_each_axis(PADE1, _pade1_dq)


def _notch(omega_n, Q):
    # 1 - (omega_n/Q) s/(s^2 + (omega_n/Q) s + omega_n^2), states scaled by omega_n
    b = omega_n / Q
    return [[-b, -omega_n], [omega_n, 0]], [[b], [0]], [[-1, 0]], [[1]]


NOTCH = ModuleKind(
    name="Notch",
    family="residual",
    law="out = (s^2 + omega_n^2)/(s^2 + (omega_n/Q) s + omega_n^2) in_",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("band", "band_integral"),
    parameters={
        "omega_n": Range(
            2 * pi * 5, 2 * pi * 1e4, 2 * pi * 100, "rad/s", "notch frequency", divides=True
        ),
        "Q": Range(0.5, 100.0, 2.0, "1", "quality factor", divides=True),
    },
    state_space=_notch,
    dc_gain=1.0,
    reference=APPENDIX,
)
