"""Memoryless algebra: signs, gains, axis selection and cross coupling, so that wiring choices are visible."""

from collections.abc import Callable, Mapping

from ibrid.modules.kind import Matrices, ModuleKind, Range
from ibrid.signals import Signal

SCALAR, DQ = Signal.SCALAR, Signal.DQ_VEC


def _static(d: list[list]) -> Matrices:
    return [], [], [[] for _ in d], d


def _memoryless(
    name: str,
    law: str,
    inputs: Mapping[str, Signal],
    outputs: Mapping[str, Signal],
    state_space: Callable[..., Matrices],
    parameters: Mapping[str, Range],
) -> ModuleKind:
    return ModuleKind(
        name=name,
        family="static",
        law=law,
        inputs=inputs,
        outputs=outputs,
        parameters=parameters,
        state_space=state_space,
        reference="paper, appendix A.6",
    )


def _gain(k):
    return _static([[k]])


def _gain_dq(k):
    return _static([[k, 0], [0, k]])


def _negate():
    return _static([[-1]])


def _negate_dq():
    return _static([[-1, 0], [0, -1]])


def _slice_d():
    return _static([[1, 0]])


def _slice_q():
    return _static([[0, 1]])


def _pack_dq():
    return _static([[1, 0], [0, 1]])


def _j_mul(L, omega_0):
    return _static([[0, -omega_0 * L], [omega_0 * L, 0]])


def _const_zero():
    return _static([[]])


_K = {"k": Range(-100.0, 100.0, 1.0, "1", "gain, may be negative")}
_L = {"L": Range(1e-5, 5.0, 2.7e-4, "s", "coupling inductance over omega_0: the per-unit value divided by omega_0")}

GAIN = _memoryless("Gain", "out = k in_", {"in_": SCALAR}, {"out": SCALAR}, _gain, _K)
GAIN_DQ = _memoryless("Gain_dq", "out = k in_ on each axis", {"in_": DQ}, {"out": DQ}, _gain_dq, _K)
NEGATE = _memoryless("Negate", "out = -in_", {"in_": SCALAR}, {"out": SCALAR}, _negate, {})
NEGATE_DQ = _memoryless("Negate_dq", "out = -in_ on each axis", {"in_": DQ}, {"out": DQ}, _negate_dq, {})
SLICE_D = _memoryless("SliceD", "out = d component of in_", {"in_": DQ}, {"out": SCALAR}, _slice_d, {})
SLICE_Q = _memoryless("SliceQ", "out = q component of in_", {"in_": DQ}, {"out": SCALAR}, _slice_q, {})
PACK_DQ = _memoryless("PackDQ", "out = [in_d, in_q]", {"in_d": SCALAR, "in_q": SCALAR}, {"out": DQ}, _pack_dq, {})
J_MUL = _memoryless("JMul", "out = omega_0 L J in_, L in seconds", {"in_": DQ}, {"out": DQ}, _j_mul, _L)
CONST_ZERO = _memoryless("ConstZero", "out = 0", {}, {"out": SCALAR}, _const_zero, {})
