"""Textbook dynamic control blocks; a `_dq` block applies the same scalar law to both axes."""

from collections.abc import Callable
from dataclasses import replace
from math import pi
from typing import Any

from ibrid.modules.kind import Matrices, ModuleKind, Range
from ibrid.signals import Signal

APPENDIX = "paper, appendix A.3"


def proportional(typical: float, unit: str = "1") -> Range:
    """Box of a proportional gain; unit : of what it gives, per unit of its input."""
    return Range(1e-6, 1e5, typical, unit, "proportional gain")


def integral(typical: float, unit: str = "1/s") -> Range:
    """Box of an integral gain; unit : of what it gives, per second and unit of its input."""
    return Range(1e-6, 1e7, typical, unit, "integral gain")


def cutoff(typical_hz: float) -> Range:
    """Box of a corner frequency."""
    return Range(
        2 * pi * 0.1, 2 * pi * 5e4, 2 * pi * typical_hz, "rad/s", "corner frequency", divides=True
    )


def on_each_axis(
    kind: ModuleKind, state_space: Callable[..., Matrices], **changes: Any
) -> ModuleKind:
    """The `_dq` block of a scalar one.

    state_space : on d and q, each state of d before that of q.
    """
    return replace(
        kind,
        name=f"{kind.name}_dq",
        law=f"{kind.law} on each axis",
        inputs={"in_": Signal.DQ_VEC},
        outputs={"out": Signal.DQ_VEC},
        states=tuple(f"{state}_{axis}" for state in kind.states for axis in "dq"),
        state_space=state_space,
        **changes,
    )


def _pi(kP, kI):
    return [[0]], [[1]], [[kI]], [[kP]]


def _pi_dq(kP, kI):
    return [[0, 0], [0, 0]], [[1, 0], [0, 1]], [[kI, 0], [0, kI]], [[kP, 0], [0, kP]]


def _low_pass(omega_c):
    return [[-omega_c]], [[omega_c]], [[1]], [[0]]


def _low_pass_dq(omega_c):
    return (
        [[-omega_c, 0], [0, -omega_c]],
        [[omega_c, 0], [0, omega_c]],
        [[1, 0], [0, 1]],
        [[0, 0], [0, 0]],
    )


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

PI_DQ = on_each_axis(PI, _pi_dq, parameters={"kP": proportional(0.4), "kI": integral(15.0)})

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

LPF1_DQ = on_each_axis(LPF1, _low_pass_dq, parameters={"omega_c": cutoff(800.0)})

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
