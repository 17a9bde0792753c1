"""A fitted model to take away: state spaces for other tools, compiled code, the admittance as a
sweep.
"""

import sys
from inspect import signature
from types import ModuleType

from ibrid.analysis.models.linear_model import LinearModel, linear_model
from ibrid.assembly.averaged import NonlinearModel
from ibrid.export.formats import FORMAT_NAMES, FORMATS, admittance, export
from ibrid.export.matrices import read_control_json
from ibrid.export.nonlinear_model import nonlinear_model

__all__ = [
    "FORMATS",
    "FORMAT_NAMES",
    "LinearModel",
    "NonlinearModel",
    "admittance",
    "export",
    "linear_model",
    "nonlinear_model",
    "read_control_json",
]


class _Callable(ModuleType):
    """`ibrid.export(record, ...)` is the function, though this package bears its name."""

    __call__ = staticmethod(export)


__signature__ = signature(export)
sys.modules[__name__].__class__ = _Callable
