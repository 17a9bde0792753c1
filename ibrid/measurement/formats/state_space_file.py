"""A state space that `ibrid export --format control-json` wrote, read as a sweep of its operating
point.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.foreign_data import json_in
from ibrid.measurement.conventions.header import known_keys
from ibrid.measurement.formats.files import read_bytes
from ibrid.measurement.formats.frd import MODEL_GRID
from ibrid.measurement.formats.model_poles import model_words
from ibrid.measurement.formats.response import sweep_of_response
from ibrid.measurement.sweeps.sweep import Sweep

SCHEMA = "ibrid.state-space/1"


@dataclass(frozen=True, eq=False)
class _Model:
    """An operating point of the file.

    `matrices` : A (n, n), B (n, 2), C (2, n), D (2, 2). `told` : op, p, q, v, f0_hz, node.
    """

    matrices: tuple[np.ndarray, ...]
    told: Mapping[str, object]


def read_state_space_file(
    path: str | Path, frequency: np.ndarray | None = None, **keys: object
) -> Sweep:
    """C (j omega I - A)^-1 B + D with the operating points, f0 and power node of the file; the
    notes say its order and poles.

    frequency : (K,) Hz at which it is sampled, by default `MODEL_GRID`. keys : as in `read_sweep`;
    they win over the file.

    Raises SweepError: the file is no such model, or has no finite response at a frequency.
    """
    path = Path(path)
    data = state_space_data(path)
    try:
        grid = MODEL_GRID if frequency is None else frequency
        sweeps = [_sweep(path, model, grid, keys) for model in _models(data)]
    except (ValueError, np.linalg.LinAlgError) as error:
        raise SweepError(
            f"{path}: the matrices and the operating point must fit together: {error}, export "
            "again."
        ) from None
    notes = tuple(dict.fromkeys(note for sweep in sweeps for note in sweep.notes))
    points = tuple(point for sweep in sweeps for point in sweep.points)
    return replace(sweeps[0], points=points, notes=notes)


def _models(data: Mapping[str, Any]) -> list[_Model]:
    """The operating points of a file; ValueError says what must hold and what was found."""
    said = data.get("operating_point")
    if not isinstance(said, dict):
        raise ValueError(
            "operating_point must hold name, p, q, v and power_node; found no such object"
        )
    names = said.get("name")
    listed = names if isinstance(names, list) else [names]
    if not listed or not all(isinstance(name, str) for name in listed):
        raise ValueError(
            "name of operating_point must be a text or a list of texts; found something else"
        )
    if not isinstance(said.get("power_node"), str):
        raise ValueError("power_node of operating_point must be a text; found something else")
    points = (len(listed),) if isinstance(names, list) else ()
    order = len(data["A"]) if isinstance(data.get("A"), list) else 0
    shapes = {"A": (order, order), "B": (order, 2), "C": (2, order), "D": (2, 2)}
    matrices = [_numbers(data, name, (*shape, *points)) for name, shape in shapes.items()]
    powers = {role: _numbers(said, role, points) for role in "pqv"}
    f0_hz = float(_numbers(data, "f0_hz", ()))
    common = {"power_node": said["power_node"], "f0_hz": f0_hz}
    return [
        _Model(
            tuple(matrix.reshape(*matrix.shape[:2], -1)[..., k] for matrix in matrices),
            {
                "op": name,
                **{role: float(power.ravel()[k]) for role, power in powers.items()},
                **common,
            },
        )
        for k, name in enumerate(listed)
    ]


def _numbers(content: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers of JSON in lists of that shape; ValueError says what was found in their place."""
    cells = np.array(content.get(name), dtype=object)
    if not all(type(cell) in (int, float) and isfinite(cell) for cell in cells.ravel()):
        raise ValueError(
            f"{name} must be {_shaped(shape)}; found something else than finite numbers"
        )
    if cells.shape != shape:
        raise ValueError(f"{name} must be {_shaped(shape)}; found {_shaped(cells.shape)}")
    return cells.astype(float)


def _shaped(shape: tuple[int, ...]) -> str:
    plain = {0: "one number", 1: f"a list of {sum(shape)} numbers"}
    return plain.get(len(shape), " x ".join(map(str, shape)) + " numbers")


def _sweep(path: Path, model: _Model, grid: np.ndarray, keys: Mapping[str, object]) -> Sweep:
    a, b, c, d = model.matrices
    s = 2j * np.pi * grid[:, None, None]
    response = c @ np.linalg.solve(s * np.eye(len(a)) - a, b + 0j) + d
    words = model_words(len(a), np.linalg.eigvals(a), 0.0, grid)
    return sweep_of_response(
        grid, response, {**model.told, **known_keys(keys)}, where=str(path), notes=(words,)
    )


def one_point(data: Mapping[str, Any], k: int) -> dict[str, Any]:
    """The same of one of several operating points, which stand on the last axis of everything that
    differs.
    """
    stacked = (*"ABCD", "v0", "i0", "p_pcc", "q_pcc")
    inner = {
        name: value[k] if isinstance(value, list) else value
        for name, value in data["operating_point"].items()
    }
    return {
        **data,
        **{
            name: np.array(data[name], dtype=float)[..., k].tolist()
            for name in stacked
            if data.get(name) is not None
        },
        "operating_point": inner,
        "parameters": {name: values[k] for name, values in data.get("parameters", {}).items()},
    }


def state_space_data(path: Path) -> dict[str, Any]:
    """What such a file says, by key.

    SweepError: it cannot be read, is no JSON, or says that it is something else.
    """
    try:
        data = json_in(read_bytes(path))
    except ValueError as error:
        raise SweepError(
            f"{path} must be a sweep or a model; found JSON that cannot be read ({error}), make it "
            "with ibrid export "
            "--format control-json."
        ) from None
    schema = data.get("schema") if isinstance(data, dict) else type(data).__name__
    if schema == "ibrid.record/1":
        raise SweepError(
            f"{path} must be a sweep or a model; found a record, make one of it with ibrid export."
        )
    if schema != SCHEMA:
        raise SweepError(
            f"{path} must have the schema {SCHEMA!r}; found {schema!r}, make it with ibrid export."
        )
    return data
