"""NumPy: one .npz archive of plain arrays; nothing in it needs pickle."""

import io

import numpy as np

from ibrid.analysis.linear_model import UNITS, LinearModel


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
