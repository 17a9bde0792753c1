"""The formats of `ibrid export`, each a function from a linear model to the content of a file."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ibrid.analysis.linear_model import LinearModel, linear_model
from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.export.admittance import ADMITTANCE_FORMATS, admittance
from ibrid.export.c_source import c_source
from ibrid.export.control_json import control_json
from ibrid.export.fmu import fmu
from ibrid.export.mat_file import mat_file
from ibrid.export.modelica import modelica
from ibrid.export.nonlinear_modelica import nonlinear_modelica
from ibrid.export.npz_file import npz_file
from ibrid.writing import require_place, write_whole

#: Formats of the state space.
FORMATS: Mapping[str, Callable[[LinearModel], bytes]] = MappingProxyType(
    {"control-json": control_json, "mat": mat_file, "npz": npz_file, "modelica": modelica, "fmu": fmu, "c": c_source}
)
#: All of them, in the order of the help.
FORMAT_NAMES = (*FORMATS, *ADMITTANCE_FORMATS)


def export(
    record: Record,
    path: str | Path,
    format: str,
    op: str | None = None,
    *,
    frequency: np.ndarray | None = None,
    nonlinear: bool = False,
) -> LinearModel:
    """Write the linear model of a record at an operating point (see `linear_model`) and return it.

    format : one of `FORMAT_NAMES`. frequency : (K,) Hz, ascending, of csv and touchstone alone.
    nonlinear : write the nonlinear averaged model that this one linearises; modelica alone (`nonlinear_model` in Python).

    Raises IbridError for an unknown format or operating point, a record without a fit, or a place that is not writable.
    """
    if format not in FORMAT_NAMES:
        raise IbridError(f"there is no export format {format!r}; {near(format, FORMAT_NAMES)}")
    if frequency is not None and format not in ADMITTANCE_FORMATS:
        raise IbridError(
            f"frequencies are for the formats {' and '.join(ADMITTANCE_FORMATS)}, which hold an admittance; {format} "
            "holds a state space, leave them out"
        )
    if nonlinear and format != "modelica":
        raise IbridError(f"the nonlinear model is written as modelica, {format} holds a linear one; choose one of them")
    require_place(path)
    if nonlinear:
        model, content = nonlinear_modelica(record, op)
        write_whole(path, content)
        return model
    model = linear_model(record, op)
    if format in ADMITTANCE_FORMATS:
        ADMITTANCE_FORMATS[format](admittance(record, op, frequency), path)
    else:
        write_whole(path, FORMATS[format](model))
    return model
