"""MATLAB and GNU Octave: a version 5 .mat file; `load` it, then sys = ss(A, B, C, D)."""

import io

import numpy as np
import scipy.io

from ibrid.analysis.linear_model import UNITS, LinearModel

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
