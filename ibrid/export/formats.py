"""The formats of `ibrid export`, each a function from a linear model to the content of a file, and how they are read back."""

import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import scipy.io

from ibrid.analysis.linear_model import UNITS, LinearModel, linear_model, whole_record, with_point
from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.export.c_source import c_source
from ibrid.export.fmu import fmu
from ibrid.export.modelica import modelica
from ibrid.export.nonlinear_modelica import nonlinear_modelica
from ibrid.measurement.csv_file import write_sweep
from ibrid.measurement.frd import MODEL_GRID
from ibrid.measurement.state_space_file import SCHEMA, state_space_data
from ibrid.measurement.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.measurement.touchstone import write_touchstone
from ibrid.writing import require_place, write_whole

if TYPE_CHECKING:
    import control


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


def control_json(model: LinearModel) -> bytes:
    """The file's content; numbers carry all their digits."""
    data = {
        "schema": SCHEMA,
        "name": model.name,
        "units": UNITS,
        "f0_hz": model.f0_hz,
        "operating_point": {"name": model.op, "p": model.p, "q": model.q, "v": model.v, "power_node": model.power_node},
        "states": model.states,
        "inputs": model.inputs,
        "outputs": model.outputs,
        **{part: getattr(model, part).tolist() for part in "ABCD"},
        "parameters": model.parameters,
        "pade_orders": model.pade_orders,
    }
    return (json.dumps(data, indent=1, allow_nan=False) + "\n").encode()


def read_control_json(path: str | Path) -> "control.StateSpace":
    """The system that `ibrid export --format control-json` wrote, with the names of its states, inputs and outputs.

    Raises IbridError, one sentence, for anything else.
    """
    import control  # python-control is slow to import

    data = state_space_data(Path(path))
    try:
        return control.StateSpace(
            *(data[part] for part in "ABCD"),
            states=data["states"],
            inputs=data["inputs"],
            outputs=data["outputs"],
            name=data["name"],
        )
    except KeyError as error:
        raise IbridError(f"{path}: lacks {error}; make it again with ibrid export") from None
    except (TypeError, ValueError, control.ControlDimension) as error:
        raise IbridError(f"{path}: the matrices and names do not fit together ({error}); export again") from None


#: The format begins with 116 bytes of free text; scipy puts the date there, and equal models would differ.
_TEXT = b"MATLAB 5.0 MAT-file, a linear inverter model written by ibrid".ljust(116)


def mat_file(model: LinearModel) -> bytes:
    """The file's content: A, B, C, D; cell arrays of names (columns); scalars f0_hz, p, q, v; texts op, units."""
    content = {
        **{part: getattr(model, part) for part in "ABCD"},
        "state_names": _cells(model.states),
        "input_names": _cells(model.inputs),
        "output_names": _cells(model.outputs),
        "parameter_names": _cells(tuple(model.parameters)),
        "parameter_values": np.array([list(model.parameters.values())], dtype=float).reshape(-1, 1),
        "name": model.name,
        "op": model.op,
        "p": model.p,
        "q": model.q,
        "v": model.v,
        "power_node": model.power_node,
        "f0_hz": model.f0_hz,
        "units": UNITS,
    }
    stream = io.BytesIO()
    scipy.io.savemat(stream, content, format="5")
    return _TEXT + stream.getvalue()[len(_TEXT) :]


def _cells(names: tuple[str, ...]) -> np.ndarray:
    cells = np.empty((len(names), 1), dtype=object)
    cells[:, 0] = names
    return cells


def npz_file(model: LinearModel) -> bytes:
    """The file's content: A, B, C, D; arrays of names; scalars f0_hz, p, q, v; texts name, op, power_node, units."""
    stream = io.BytesIO()
    np.savez(
        stream,
        **{part: getattr(model, part) for part in "ABCD"},
        state_names=np.array(model.states, dtype=str),
        input_names=np.array(model.inputs, dtype=str),
        output_names=np.array(model.outputs, dtype=str),
        parameter_names=np.array(list(model.parameters), dtype=str),
        parameter_values=np.array(list(model.parameters.values()), dtype=float),
        name=np.array(model.name),
        op=np.array(model.op),
        p=np.array(model.p),
        q=np.array(model.q),
        v=np.array(model.v),
        power_node=np.array(model.power_node),
        f0_hz=np.array(model.f0_hz),
        units=np.array(UNITS),
    )
    return stream.getvalue()


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
