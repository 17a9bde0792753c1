"""JSON for python-control: matrices with their names, read back as a StateSpace."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

from ibrid.analysis.linear_model import UNITS, LinearModel
from ibrid.errors import IbridError
from ibrid.measurement.state_space_file import SCHEMA, state_space_data

if TYPE_CHECKING:
    import control


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
