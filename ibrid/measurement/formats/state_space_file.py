"""A state space that `ibrid export --format control-json` wrote, read as a sweep of its operating point."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.foreign_data import json_in
from ibrid.measurement.conventions.header import known_keys
from ibrid.measurement.formats.files import read_bytes
from ibrid.measurement.formats.frd import MODEL_GRID
from ibrid.measurement.formats.response import sweep_of_response
from ibrid.measurement.sweeps.sweep import Sweep

SCHEMA = "ibrid.state-space/1"


def read_state_space_file(path: str | Path, **keys: object) -> Sweep:
    """C (j omega I - A)^-1 B + D on `MODEL_GRID`, with the operating points, f0 and power node of the file.

    keys : as in `read_sweep`; they win over the file.

    Raises SweepError: the file is no such model, or has no finite response at a frequency.
    """
    path = Path(path)
    data = state_space_data(path)
    try:
        names = data["operating_point"]["name"]
        points = [data] if isinstance(names, str) else [one_point(data, k) for k in range(len(names))]
        sweeps = [_sweep(path, one, keys) for one in points]
    except (KeyError, IndexError, TypeError, ValueError, np.linalg.LinAlgError) as error:
        raise SweepError(
            f"{path}: the matrices and the operating point must fit together; found {type(error).__name__}: {error}, "
            "export again."
        ) from None
    return replace(sweeps[0], points=tuple(point for sweep in sweeps for point in sweep.points))


def _sweep(path: Path, data: Mapping[str, Any], keys: Mapping[str, object]) -> Sweep:
    a, b, c, d = (np.array(data[part], dtype=float) for part in "ABCD")
    s = 2j * np.pi * MODEL_GRID[:, None, None]
    response = c @ np.linalg.solve(s * np.eye(len(a)) - a, b + 0j) + d
    point = data["operating_point"]
    inside = {"op": point["name"], **{key: point[key] for key in ("p", "q", "v", "power_node")}}
    inside["f0_hz"] = data["f0_hz"]
    if response.shape[1:] != (2, 2):
        raise SweepError(f"{path} must have two inputs and two outputs; found {response.shape[:0:-1]}.")
    return sweep_of_response(MODEL_GRID, response, inside | known_keys(keys), where=str(path))


def one_point(data: Mapping[str, Any], k: int) -> dict[str, Any]:
    """The same of one of several operating points, which stand on the last axis of everything that differs."""
    stacked = (*"ABCD", "v0", "i0", "p_pcc", "q_pcc")
    inner = {name: value[k] if isinstance(value, list) else value for name, value in data["operating_point"].items()}
    return {
        **data,
        **{name: np.array(data[name], dtype=float)[..., k].tolist() for name in stacked if data.get(name) is not None},
        "operating_point": inner,
        "parameters": {name: values[k] for name, values in data.get("parameters", {}).items()},
    }


def state_space_data(path: Path) -> dict[str, Any]:
    """What such a file says, by key. SweepError: it cannot be read, is no JSON, or says that it is something else."""
    try:
        data = json_in(read_bytes(path).decode("utf-8-sig"))
    except ValueError:
        raise SweepError(
            f"{path} must be a sweep or a model; found JSON that cannot be read, make it with ibrid export "
            "--format control-json."
        ) from None
    schema = data.get("schema") if isinstance(data, dict) else type(data).__name__
    if schema == "ibrid.record/1":
        raise SweepError(f"{path} must be a sweep or a model; found a record, make one of it with ibrid export.")
    if schema != SCHEMA:
        raise SweepError(f"{path} must have the schema {SCHEMA!r}; found {schema!r}, make it with ibrid export.")
    return data
