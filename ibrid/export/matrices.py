"""Matrices, names and operating point as data: JSON, MATLAB and NumPy files, of one operating point
or of several.

Several points stand on a last axis of everything that differs: A (n, n, K), v0 (2, K), p (K,), a
list of names op.
"""

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.io

from ibrid.analysis.models.linear_model import UNITS, LinearModel
from ibrid.border import takes_kinds
from ibrid.errors import IbridError, near
from ibrid.interrupts import undisturbed
from ibrid.measurement.formats.state_space_file import SCHEMA, one_point, state_space_data
from ibrid.writing import json_lines

if TYPE_CHECKING:
    import control

_NUMBERS = (*"ABCD", "v0", "i0", "p_pcc", "q_pcc")
_COMMON = ("f0_hz", "omega_0", "s_base_va", "v_base_v")


def _stacked(models: Sequence[LinearModel], part: Callable[[LinearModel], Any]) -> np.ndarray:
    """A number or array of one model as it is, of several on a last axis."""
    found = [np.asarray(part(one), dtype=float) for one in models]
    return found[0] if len(found) == 1 else np.stack(found, axis=-1)


def _same_states(models: Sequence[LinearModel]) -> LinearModel:
    first = models[0]
    for one in models[1:]:
        if (one.states, tuple(one.parameters)) != (first.states, tuple(first.parameters)):
            raise IbridError(
                f"{first.op} and {one.op} have other states, which do not stack; export them one "
                "by one"
            )
    return first


def control_json(*models: LinearModel) -> bytes:
    """The file's content; numbers carry all their digits, what is not known is null."""
    model, many = _same_states(models), len(models) > 1

    def told(part: Callable[[LinearModel], Any]) -> Any:
        return [part(point) for point in models] if many else part(model)

    numbers = {
        name: _stacked(models, lambda point, name=name: getattr(point, name)) for name in _NUMBERS
    }
    data = {
        "schema": SCHEMA,
        "name": model.name,
        "units": UNITS,
        **{name: getattr(model, name) for name in _COMMON},
        "operating_point": {
            "name": told(lambda point: point.op),
            **{key: told(lambda point, key=key: getattr(point, key)) for key in "pqv"},
            "power_node": model.power_node,
        },
        "states": model.states,
        "inputs": model.inputs,
        "outputs": model.outputs,
        **{name: one.tolist() if np.isfinite(one).all() else None for name, one in numbers.items()},
        "parameters": {
            name: told(lambda point, name=name: point.parameters[name]) for name in model.parameters
        },
        "pade_orders": model.pade_orders,
    }
    return json_lines(data).encode()


@takes_kinds
def read_control_json(path: str | Path, op: str | None = None) -> "control.StateSpace":
    """The system that `ibrid export --format control-json` wrote, with the names of its states,
    inputs and outputs.

    op : name of one of the points, where the file has several.

    Raises IbridError, one sentence, for anything else.
    """
    with undisturbed():
        import control  # python-control is slow to import

    data = state_space_data(Path(path))
    try:
        names = data["operating_point"]["name"] if "operating_point" in data else ""
        if not isinstance(names, str):
            if op not in names:
                raise IbridError(
                    f"{path} has {len(names)} operating points; {near(op or '', names)}"
                )
            data = one_point(data, names.index(op))
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
        raise IbridError(
            f"{path}: the matrices and names do not fit together ({error}); export again"
        ) from None


#: The format begins with 116 bytes of free text; scipy puts the date there, and equal models would
#: differ.
_TEXT = b"MATLAB 5.0 MAT-file, a linear inverter model written by ibrid".ljust(116)


def mat_file(*models: LinearModel) -> bytes:
    """The file's content: A, B, C, D; v0, i0, p_pcc, q_pcc, omega_0, s_base_va, v_base_v (NaN where
    they are not known); cell arrays of names (columns); scalars f0_hz, p, q, v; texts op, units. Of
    several points op is a column of names.
    """
    content = _arrays(models, lambda names: np.array(names, dtype=object)[:, None])
    content |= {
        name: content[name].reshape(len(content[name]), -1)
        for name in ("v0", "i0", "parameter_values")
    }
    stream = io.BytesIO()
    scipy.io.savemat(stream, content, format="5")
    return _TEXT + stream.getvalue()[len(_TEXT) :]


def npz_file(*models: LinearModel) -> bytes:
    """The file's content, named as in `mat_file`: arrays of numbers and of names."""
    stream = io.BytesIO()
    content = _arrays(models, lambda names: np.array(names, dtype=str))
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in content.items()}
    np.savez(stream, **arrays)
    return stream.getvalue()


def _arrays(
    models: Sequence[LinearModel], listed: Callable[[Sequence[str]], np.ndarray]
) -> dict[str, Any]:
    model = _same_states(models)
    unknown = float("nan")
    return {
        **{
            name: _stacked(models, lambda point, name=name: getattr(point, name))
            for name in (*_NUMBERS, *"pqv")
        },
        **{name: unknown if (value := getattr(model, name)) is None else value for name in _COMMON},
        "state_names": listed(model.states),
        "input_names": listed(model.inputs),
        "output_names": listed(model.outputs),
        "parameter_names": listed(tuple(model.parameters)),
        "parameter_values": _stacked(models, lambda point: list(point.parameters.values())),
        "name": model.name,
        "op": model.op if len(models) == 1 else listed([point.op for point in models]),
        "power_node": model.power_node,
        "units": UNITS,
    }
