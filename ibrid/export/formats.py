"""The formats of `ibrid export`, each a function from a linear model to the content of a file, and how they are read back."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ibrid.analysis.linear_model import LinearModel, linear_model, whole_record, with_point
from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.export.c_source import c_source
from ibrid.export.fmu import fmu
from ibrid.export.matrices import control_json, mat_file, npz_file
from ibrid.export.modelica import modelica
from ibrid.export.names import identifier
from ibrid.export.nonlinear_modelica import nonlinear_modelica
from ibrid.measurement.csv_file import write_sweep
from ibrid.measurement.frd import MODEL_GRID
from ibrid.measurement.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.measurement.touchstone import write_touchstone
from ibrid.writing import require_place, write_whole


def admittance(record: Record, op: str | None = None, frequency: np.ndarray | None = None) -> Sweep:
    """What a noiseless measurement of a record's model would give, in the frame of the PCC voltage.

    op : as in `linear_model`. frequency : (K,) Hz, ascending, by default `MODEL_GRID`.

    Raises OperatingPointError and IbridError as `linear_model`, SweepError for a grid that is none.
    """
    with whole_record():
        whole, name = with_point(record, op)
        point = whole.settings["operating_points"][name]
        grid = MODEL_GRID if frequency is None else np.asarray(frequency, dtype=float)
        at = OperatingPoint(name, float(point["p"]), float(point["q"]), float(point["v"]))
        return Sweep(
            points=(PointSweep(at, grid, whole.response(name, grid)),),
            f0_hz=float(whole.settings["f0_hz"]),
            power_node=whole.settings["power_node"],
            source="a fitted model",
        )


def _write_csv(sweep: Sweep, path: str | Path) -> None:
    write_sweep(sweep, path, header=("admittance of a fitted model, not a measurement; delays are exact",))


def _write_touchstone(sweep: Sweep, path: str | Path) -> None:
    write_touchstone(sweep, path, sweep.names[0])


#: Formats of the admittance: name -> function that writes a sweep of one operating point.
ADMITTANCE_FORMATS: Mapping[str, Callable[[Sweep, str | Path], None]] = MappingProxyType(
    {"csv": _write_csv, "touchstone": _write_touchstone}
)


#: Formats of the state space.
FORMATS: Mapping[str, Callable[[LinearModel], bytes]] = MappingProxyType(
    {"control-json": control_json, "mat": mat_file, "npz": npz_file, "modelica": modelica, "fmu": fmu, "c": c_source}
)
#: Those that hold several operating points, and those in which a name is a word of the language.
STACKED: Mapping[str, Callable[..., bytes]] = MappingProxyType(
    {"control-json": control_json, "mat": mat_file, "npz": npz_file}
)
NAMED = ("modelica", "fmu", "c")
#: All of them, in the order of the help.
FORMAT_NAMES = (*FORMATS, *ADMITTANCE_FORMATS)


def export(
    record: Record,
    path: str | Path,
    format: str,
    op: str | None = None,
    *,
    name: str | None = None,
    frequency: np.ndarray | None = None,
    nonlinear: bool = False,
) -> LinearModel:
    """Write the linear model of a record at an operating point (see `linear_model`) and return it.

    format : one of `FORMAT_NAMES`. op : "all" stacks all points of the record, in the formats `STACKED`; the first is returned.
    name : of the model: the C symbols, the FMU's modelName, the Modelica class. frequency : (K,) Hz, ascending, of csv and
    touchstone alone. nonlinear : write the nonlinear averaged model that this one linearises; modelica alone
    (`nonlinear_model` in Python).

    Raises IbridError for an unknown format or operating point, a name that is none, a record without a fit, or a place that is
    not writable.
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
    if op == "all" and "all" not in record.parameters and (format not in STACKED or nonlinear):
        raise IbridError(f"all operating points go into {', '.join(STACKED)}; {format} holds one, choose it with --op")
    if name is not None and format in ADMITTANCE_FORMATS:
        raise IbridError(f"a name is for models, {format} holds an admittance; leave it out")
    titled = {} if name is None else {"name": identifier(name)}
    require_place(path)
    if nonlinear:
        model, content = nonlinear_modelica(record, op, **titled)
        write_whole(path, content)
        return model
    if op == "all" and "all" not in record.parameters:
        models = [replace(linear_model(record, one), **titled) for one in record.parameters]
        write_whole(path, STACKED[format](*models))
        return models[0]
    model = replace(linear_model(record, op), **titled)
    if format in ADMITTANCE_FORMATS:
        ADMITTANCE_FORMATS[format](admittance(record, op, frequency), path)
    else:
        write_whole(path, FORMATS[format](model, **(titled if format in NAMED else {})))
    return model
