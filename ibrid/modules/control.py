"""Textbook dynamic control blocks; a `_dq` block applies the same scalar law to both axes."""

from dataclasses import replace
from math import pi

from ibrid.modules.kind import ModuleKind, Range
from ibrid.signals import Signal

APPENDIX = "paper, appendix A.3"


def proportional(typical: float) -> Range:
    """Box of a proportional gain."""
    return Range(1e-6, 1e5, typical, "1", "proportional gain")


def integral(typical: float) -> Range:
    """Box of an integral gain."""
    return Range(1e-6, 1e7, typical, "1/s", "integral gain")


def cutoff(typical_hz: float) -> Range:
    """Box of a corner frequency."""
    return Range(2 * pi * 0.1, 2 * pi * 5e4, 2 * pi * typical_hz, "rad/s", "corner frequency", divides=True)


def _pi(kP, kI):
    return [[0]], [[1]], [[kI]], [[kP]]


def _pi_dq(kP, kI):
    return [[0, 0], [0, 0]], [[1, 0], [0, 1]], [[kI, 0], [0, kI]], [[kP, 0], [0, kP]]


def _low_pass(omega_c):
    return [[-omega_c]], [[omega_c]], [[1]], [[0]]


def _low_pass_dq(omega_c):
    return [[-omega_c, 0], [0, -omega_c]], [[omega_c, 0], [0, omega_c]], [[1, 0], [0, 1]], [[0, 0], [0, 0]]


def _integrator():
    return [[0]], [[1]], [[1]], [[0]]


PI = ModuleKind(
    name="PI",
    family="dynamic control",
    law="out = (kP + kI/s) in_",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("integral",),
    parameters={"kP": proportional(0.02), "kI": integral(20.0)},
    state_space=_pi,
    reference=APPENDIX,
)

PI_DQ = replace(
    PI,
    name="PI_dq",
    law=f"{PI.law} on each axis",
    inputs={"in_": Signal.DQ_VEC},
    outputs={"out": Signal.DQ_VEC},
    states=("integral_d", "integral_q"),
    parameters={"kP": proportional(0.4), "kI": integral(15.0)},
    state_space=_pi_dq,
)

LPF1 = ModuleKind(
    name="LPF1",
    family="dynamic control",
    law="out = omega_c/(s + omega_c) in_",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("filtered",),
    parameters={"omega_c": cutoff(200.0)},
    state_space=_low_pass,
    dc_gain=1.0,
    reference=APPENDIX,
)

LPF1_DQ = replace(
    LPF1,
    name="LPF1_dq",
    law=f"{LPF1.law} on each axis",
    inputs={"in_": Signal.DQ_VEC},
    outputs={"out": Signal.DQ_VEC},
    states=("filtered_d", "filtered_q"),
    parameters={"omega_c": cutoff(800.0)},
    state_space=_low_pass_dq,
)

INTEGRATOR = ModuleKind(
    name="Integrator",
    family="dynamic control",
    law="out = in_/s",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("integral",),
    state_space=_integrator,
    reference=APPENDIX,
)
