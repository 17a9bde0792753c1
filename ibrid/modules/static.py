"""Memoryless algebra: signs, gains, axis selection and cross coupling, so that wiring choices are
visible.
"""

from ibrid.modules.control import on_each_axis
from ibrid.modules.kind import Matrices, ModuleKind, Range
from ibrid.signals import Signal

SCALAR, DQ = Signal.SCALAR, Signal.DQ_VEC
STATIC, APPENDIX = "static", "paper, appendix A.6"


def _static(d: list[list]) -> Matrices:
    return [], [], [[] for _ in d], d


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
_L = {
    "L": Range(
        1e-5,
        5.0,
        2.7e-4,
        "s",
        "coupling inductance over omega_0: the per-unit value divided by omega_0",
    )
}

GAIN = ModuleKind(
    "Gain", STATIC, "out = k in_", {"in_": SCALAR}, {"out": SCALAR}, _gain, APPENDIX, parameters=_K
)
GAIN_DQ = on_each_axis(GAIN, _gain_dq)
NEGATE = ModuleKind(
    "Negate", STATIC, "out = -in_", {"in_": SCALAR}, {"out": SCALAR}, _negate, APPENDIX
)
NEGATE_DQ = on_each_axis(NEGATE, _negate_dq)
SLICE_D = ModuleKind(
    "SliceD", STATIC, "out = d component of in_", {"in_": DQ}, {"out": SCALAR}, _slice_d, APPENDIX
)
SLICE_Q = ModuleKind(
    "SliceQ", STATIC, "out = q component of in_", {"in_": DQ}, {"out": SCALAR}, _slice_q, APPENDIX
)
PACK_DQ = ModuleKind(
    "PackDQ",
    STATIC,
    "out = [in_d, in_q]",
    {"in_d": SCALAR, "in_q": SCALAR},
    {"out": DQ},
    _pack_dq,
    APPENDIX,
)
J_MUL = ModuleKind(
    "JMul",
    STATIC,
    "out = omega_0 L J in_, L in seconds",
    {"in_": DQ},
    {"out": DQ},
    _j_mul,
    APPENDIX,
    parameters=_L,
)
CONST_ZERO = ModuleKind("ConstZero", STATIC, "out = 0", {}, {"out": SCALAR}, _const_zero, APPENDIX)
