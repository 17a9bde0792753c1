"""Sweeps from MATLAB .mat files with numeric variables: w (rad/s) or frequency (Hz), and Y or Z."""

import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import SweepError, near
from ibrid.measurement.conventions.conversions import Quantity
from ibrid.measurement.conventions.header import HEADER_KEYS, POINT_KEYS, meant_by
from ibrid.measurement.formats.files import read_bytes
from ibrid.measurement.formats.frd import stacked
from ibrid.measurement.formats.guarded import guarded
from ibrid.measurement.formats.response import Response, sidecar_keys
from ibrid.measurement.importing.binary.foreign_binary import mat_arrays
from ibrid.measurement.importing.frequency_unit import measure_keyed, measure_of
from ibrid.measurement.importing.importing import import_tables
from ibrid.measurement.importing.models.matlab_objects import classes_among, how_to_save
from ibrid.measurement.importing.models.state_spaces import state_space_tables
from ibrid.measurement.sweeps.sweep import Sweep

#: What leaves the process that reads the file: variables of these names, whole and other numbers or
#: text, and single texts.
_WANTED, _PLAIN = {*HEADER_KEYS, *POINT_KEYS, "w", "frequency", "Y", "Z"}, "iufcU"


def read_mat(path: str | Path, frequency: np.ndarray | None = None, **keys: Any) -> Sweep:
    """Read one operating point from a MAT file of version 7 or older, or a state space, sampled at
    `frequency` (Hz).

    Variables: `w` (rad/s) or `frequency` (Hz, or what a text such as FrequencyUnit says), K
    numbers; `Y` (or `Z`), 2x2xK or Kx2x2 complex; optional p, q, v, op, f0_hz and the other header
    keys, numbers or text. What is missing may stand in `<path>.meta` or in `keys`; the later win.

    Raises SweepError: not a MAT file, version 7.3, frd objects, missing variables, shapes that do
    not fit.
    """
    path = Path(path)
    beside, notes = sidecar_keys(path)
    variables = _variables(path)
    if not {"Y", "Z"} & variables.keys() and (
        models := state_space_tables(_arrays(path), str(path), path.stem, frequency)
    ):
        told = [*(f"{key}: {value}" for key, value in beside.items()), *notes]
        return import_tables(
            [replace(one, notes=(*told, *one.notes)) for one in models], **keys
        ).answered()
    _refuse_objects(variables, path)
    inside = {
        key: _scalar(variables[key], f"{path}: variable {key}")
        for key in HEADER_KEYS + POINT_KEYS
        if key in variables
    }
    measured_at = _frequency(variables, path)
    _refuse_near_keys(variables, path)
    letters = [letter for letter in "YZ" if letter in variables]
    if len(letters) != 1:
        found = "both" if letters else f"neither, {near('Y', variables)}"
        raise SweepError(
            f"{path} must hold the 2x2xK matrices as one variable Y (or Z); found {found}"
        )
    response = stacked(
        _numeric(variables, letters[0], path),
        len(measured_at),
        f"{path}: {letters[0]}",
        frequency_last=True,
    )
    held = Response(
        measured_at, response, Quantity(letters[0]), {**inside, **beside}, notes, path.stem
    )
    return held.sweep(path, keys)


def _variables(path: Path) -> dict[str, np.ndarray]:
    content = read_bytes(path)
    if not content:
        raise SweepError(f"{path} must hold a sweep; found an empty file.")
    if content[:8] == b"\x89HDF\r\n\x1a\n" or content[512:520] == b"\x89HDF\r\n\x1a\n":
        raise SweepError(
            f"{path} must be a MAT file of version 7 or older; found 7.3 (HDF5), read it with "
            "ibrid import, or save it with -v7."
        )
    if content[126:128] not in (b"IM", b"MI") and (
        len(content) < 20 or 0 not in content[:4]
    ):  # of version 5, or of 4
        raise SweepError(
            f"{path} must be a MAT file; its header is none of MATLAB's, save it with -v7."
        )
    return guarded(mat_variables, content, f"{path} must be a MAT file")


def _arrays(path: Path) -> dict[str, np.ndarray]:
    return guarded(mat_arrays, read_bytes(path), f"{path} must be a MAT file")


def mat_variables(content: bytes) -> dict[str, np.ndarray]:
    """What a sweep may use, by name; of everything else the name of its type, as bytes."""
    from scipy.io import loadmat

    return {
        name: value
        if isinstance(value, np.ndarray)
        and value.dtype.kind in _PLAIN
        and (name in _WANTED or value.size == 1)
        else np.array(" ".join((type(value).__name__, *classes_among({name: value}))).encode())
        for name, value in loadmat(io.BytesIO(content), struct_as_record=True).items()
    }


def _refuse_objects(variables: Mapping[str, np.ndarray], path: Path) -> None:
    """MATLAB objects (frd, idfrd, table) are opaque outside MATLAB; only a sweep that depends on
    one is refused.
    """
    if "Y" in variables or "Z" in variables:
        return
    kinds = [
        value.item().decode(errors="replace")
        for value in variables.values()
        if value.dtype.kind == "S"
    ]
    objects = [kind for kind in kinds if kind.startswith(("MatlabOpaque", "MatlabObject"))]
    if objects or "__function_workspace__" in variables:
        name = objects[0].partition(" ")[2] if objects else ""
        raise SweepError(
            f"{path} must hold numeric variables; found a MATLAB object, {how_to_save(name)}."
        )


def _frequency(variables: Mapping[str, np.ndarray], path: Path) -> np.ndarray:
    """Hz, from w in rad/s or frequency in Hz or as a text says; both may be there if they agree."""
    given = [name for name in ("frequency", "w") if name in variables]
    if not given:
        names = [name for name in variables if not name.startswith("__")]
        raise SweepError(
            f"{path} must hold w (rad/s) or frequency (Hz); {near('frequency', names)}"
        )
    texts = [
        f"{name}: {value.ravel()[0]}"
        for name, value in variables.items()
        if value.dtype.kind == "U" and value.size == 1
    ]
    keyed = measure_keyed(texts, {}, where=str(path))
    if keyed and "w" in given and keyed[0] != ("angular frequency", 1.0):
        raise SweepError(
            f"{path}: w must be in rad/s; found {keyed[1]} said beside it, call it frequency or "
            "correct that."
        )
    if not keyed and given == ["frequency"]:
        _refuse_a_unit_of_nothing(variables, path)
    dimension, factor = keyed[0] if keyed else ("frequency", 1.0)
    factors = {
        "w": 1 / (2 * np.pi),
        "frequency": factor / (2 * np.pi if dimension == "angular frequency" else 1.0),
    }
    values = [_real(variables, name, path).ravel() * factors[name] for name in given]
    if len(values) == 2 and not (
        values[0].shape == values[1].shape and np.allclose(*values, rtol=1e-6, atol=0)
    ):
        raise SweepError(
            f"{path}: w must be 2 pi times frequency; found both and they differ, remove one."
        )
    return values[0]


def _refuse_near_keys(variables: Mapping[str, np.ndarray], path: Path) -> None:
    """SweepError where a single number or text has a name that nearly is that of a key, as f0 for
    f0_hz.
    """
    for name, value in variables.items():
        if name in _WANTED or value.size != 1 or value.dtype.kind not in _PLAIN:
            continue
        if likely := meant_by(name, str(value.ravel()[0]), HEADER_KEYS):
            raise SweepError(
                f"{path}: variable {name} is not a key, {likely}; call it so, or leave it out."
            )


def _refuse_a_unit_of_nothing(variables: Mapping[str, np.ndarray], path: Path) -> None:
    """SweepError where a text is a unit in which frequencies may be, and its name does not say of
    what.
    """
    for name, value in variables.items():
        measure = (
            measure_of(str(value.ravel()[0]))
            if value.dtype.kind == "U" and value.size == 1
            else None
        )
        if measure and measure != ("frequency", 1.0):
            raise SweepError(
                f"{path}: frequency must have a unit; found {value.ravel()[0]} in {name}, call "
                "that FrequencyUnit if it is meant."
            )


def _numeric(variables: Mapping[str, np.ndarray], name: str, path: Path) -> np.ndarray:
    value = variables[name]
    if value.dtype.kind not in "iufc":
        found = value.item().decode() if value.dtype.kind == "S" else "text"
        raise SweepError(f"{path}: variable {name} must be a full numeric array; found {found}.")
    return value.astype(complex)


def _real(variables: Mapping[str, np.ndarray], name: str, path: Path) -> np.ndarray:
    value = _numeric(variables, name, path)
    imaginary = np.imag(value)
    if imaginary.any():
        found = value.ravel()[np.flatnonzero(imaginary)[0]]
        raise SweepError(
            f"{path}: variable {name} must hold real numbers; found {found}, save its real part if "
            "it is meant."
        )
    return np.real(value)


def _scalar(value: Any, what: str) -> object:
    """A single number or text."""
    array = np.asarray(value)
    if array.size != 1 or array.dtype.kind == "S":
        raise SweepError(f"{what} must be a single number or text; found shape {array.shape}.")
    item = array.ravel()[0]
    return str(item) if array.dtype.kind == "U" else item
