"""The formats of `ibrid export`, each a function from a linear model to the content of a file, and
how they are read back.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ibrid.analysis.models.linear_model import (
    LinearModel,
    linear_model,
    whole_record,
    with_point,
    without_dust,
)
from ibrid.border import takes_kinds
from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.export.andes import andes
from ibrid.export.c_source import c_source
from ibrid.export.cigre import cigre
from ibrid.export.fmu import fmu
from ibrid.export.matrices import control_json, mat_file, npz_file
from ibrid.export.modelica import modelica
from ibrid.export.names import identifier
from ibrid.export.nonlinear_c import nonlinear_c
from ibrid.export.nonlinear_model import nonlinear_model
from ibrid.export.nonlinear_modelica import nonlinear_modelica
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.formats.frd import MODEL_GRID
from ibrid.measurement.formats.touchstone import write_touchstone
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.writing import require_place, write_whole


@takes_kinds
def admittance(record: Record, op: str | None = None, frequency: np.ndarray | None = None) -> Sweep:
    """What a noiseless measurement of a record's model would give, in the frame of the PCC voltage.

    op : as in `linear_model`. frequency : (K,) Hz, ascending, by default `MODEL_GRID`.

    Raises OperatingPointError and IbridError as `linear_model`, SweepError for a grid that is none.
    """
    with whole_record():
        whole, name = with_point(record, op)
        grid = MODEL_GRID if frequency is None else np.asarray(frequency, dtype=float)
        return Sweep(
            points=(
                PointSweep(whole.point(name), grid, whole.response(name, grid), predicted=True),
            ),
            f0_hz=float(whole.settings["f0_hz"]),
            power_node=whole.settings["power_node"],
            source="a fitted model",
        )


#: Formats of the admittance: name -> function that writes a sweep of one operating point.
ADMITTANCE_FORMATS: Mapping[str, Callable[[Sweep, str | Path], None]] = MappingProxyType(
    {
        "csv": partial(
            write_sweep,
            header=("admittance of a fitted model, not a measurement; delays are exact",),
        ),
        "touchstone": lambda sweep, path: write_touchstone(sweep, path, sweep.names[0]),
    }
)


#: Formats of the state space.
FORMATS: Mapping[str, Callable[..., bytes]] = MappingProxyType(
    {
        "control-json": control_json,
        "mat": mat_file,
        "npz": npz_file,
        "modelica": modelica,
        "fmu": fmu,
        "c": c_source,
        "andes": andes,
    }
)
#: Those that hold several operating points, and those in which a name is a word of the language.
STACKED = ("control-json", "mat", "npz")
NAMED = ("modelica", "fmu", "c", "andes", "cigre")
#: Those of the nonlinear averaged model too, and those of it alone.
NONLINEAR, ALWAYS_NONLINEAR = ("modelica", "fmu", "c", "cigre"), ("cigre",)
#: All of them, in the order of the help.
FORMAT_NAMES = (*FORMATS, *ALWAYS_NONLINEAR, *ADMITTANCE_FORMATS)


@takes_kinds
def export(
    record: Record,
    path: str | Path,
    format: str,
    op: str | None = None,
    *,
    name: str | None = None,
    frequency: np.ndarray | None = None,
    nonlinear: bool = False,
    windows: bool = False,
) -> LinearModel:
    """Write the linear model of a record at an operating point (see `linear_model`), source code
    `without_dust`, and return it.

    format : one of `FORMAT_NAMES`. op : "all" stacks all points of the record, in the formats
    `STACKED`; the first is returned.
    name : of the model: the C symbols, the FMU's modelName, the Modelica class. frequency : (K,)
    Hz, ascending, of csv and
    touchstone alone. nonlinear : write the nonlinear averaged model that this one linearises, in
    the formats `NONLINEAR` (`nonlinear_model` in Python); cigre is always that, and writes its C
    source and the library beside each other.
    windows : of fmu and cigre, with a library for Windows, by the package ziglang.

    Raises IbridError for an unknown format or operating point, a name that is none, a record
    without a fit, or a place that is not writable.
    """
    every = op == "all" and "all" not in record.parameters
    if format not in FORMAT_NAMES:
        raise IbridError(f"there is no export format {format!r}; {near(format, FORMAT_NAMES)}")
    if frequency is not None and format not in ADMITTANCE_FORMATS:
        raise IbridError(
            f"frequencies are for the formats {' and '.join(ADMITTANCE_FORMATS)}, which hold an "
            f"admittance; {format} "
            "holds a state space, leave them out"
        )
    if nonlinear and format not in NONLINEAR:
        raise IbridError(
            f"the nonlinear model is written as {', '.join(NONLINEAR)}; {format} holds a linear one"
        )
    if windows and format not in ("fmu", "cigre"):
        raise IbridError(
            f"a library for Windows is part of fmu and cigre; {format} holds none, leave --windows "
            "out"
        )
    if every and (format not in STACKED or nonlinear):
        raise IbridError(
            f"all operating points go into {', '.join(STACKED)}; {format} holds one, choose it "
            "with --op"
        )
    if name is not None and format in ADMITTANCE_FORMATS:
        raise IbridError(f"a name is for models, {format} holds an admittance; leave it out")
    titled = {} if name is None else {"name": identifier(name)}
    require_place(path)
    if every:
        models = [replace(linear_model(record, one), **titled) for one in record.parameters]
        write_whole(path, FORMATS[format](*models))
        return models[0]
    model = replace(linear_model(record, op), **titled)
    if nonlinear or format in ALWAYS_NONLINEAR:
        _write_nonlinear(record, model, Path(path), format, windows, titled)
    elif format in ADMITTANCE_FORMATS:
        ADMITTANCE_FORMATS[format](admittance(record, op, frequency), path)
    else:
        options = {**(titled if format in NAMED else {}), **({"windows": True} if windows else {})}
        write_whole(
            path, FORMATS[format](without_dust(model) if format in NAMED else model, **options)
        )
    return model


def _write_nonlinear(
    record: Record,
    model: LinearModel,
    path: Path,
    format: str,
    windows: bool,
    titled: dict[str, str],
) -> None:
    if format == "modelica":
        write_whole(path, nonlinear_modelica(record, model.op, **titled)[1])
        return
    moving = nonlinear_model(record, model.op)
    if format == "c":
        write_whole(path, nonlinear_c(model, moving, **titled))
    elif format == "fmu":
        write_whole(path, fmu(model, moving=moving, windows=windows, **titled))
    else:
        made = cigre(model, moving, windows=windows or path.suffix == ".dll", **titled)
        source, library = files_of_cigre(path, made.library.suffix)
        require_place(source)
        write_whole(source, made.source)
        write_whole(library, made.library.content)


def files_of_cigre(path: Path, suffix: str) -> tuple[Path, Path]:
    """Source and library, of which one is `path`; where its ending is neither's, the library is."""
    if path.suffix == ".c":
        return path, path.with_suffix(suffix)
    known = path.suffix in (".so", ".dll", ".dylib")
    return (path.with_suffix(".c") if known else Path(f"{path}.c")), path
