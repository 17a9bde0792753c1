"""What a frequency response says beside its numbers: how its inputs and outputs are called, and
delays that it keeps apart.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from ibrid.errors import SweepError

_NAMES, _DELAYS = ("InputName", "OutputName"), ("InputDelay", "OutputDelay", "IODelay", "ioDelay")
#: The axis with which a name ends: v_D, iq, Vq [kV].
_AXIS = re.compile(r"[dq](?=[^a-z]*(?:\b|$)[^a-z]*$|\s*[\[(])")


def q_first(labels: Sequence[str]) -> bool:
    """Whether two names of inputs or outputs say that q comes before d."""
    found = [_AXIS.search(str(label).lower()) for label in labels]
    return [one[0] for one in found if one] == ["q", "d"] and len(labels) == 2


def require_d_first(labels: Sequence[str], what: str) -> None:
    """Raise SweepError where two names of inputs or outputs say that q comes before d: rows and
    columns are read d first.

    what : the names, for the sentence.
    """
    if q_first(labels):
        raise SweepError(
            f"{what} must name d before q, in which order rows and columns are read; found "
            f"{', '.join(map(str, labels))}, "
            "exchange the rows or the columns with their names."
        )


def require_plain_responses(arrays: Mapping[str, np.ndarray], where: str) -> None:
    """Raise SweepError where a structure of MATLAB has names with q before d, or delays that its
    responses do not hold.
    """
    names: dict[str, list[str]] = {}
    for path, value in arrays.items():
        key = path.rsplit(".", 1)[-1].partition("{")[0]
        if key in _NAMES and value.dtype.kind == "U":
            names.setdefault(path.partition("{")[0], []).extend(
                map(str.strip, value.ravel().tolist())
            )
        if key in _DELAYS and value.dtype.kind in "biuf" and value.any():
            found = value.ravel()[value.ravel() != 0][0]
            raise SweepError(
                f"{where}: {path} must be zero, since a response is read as it stands; found "
                f"{found:g}, save "
                "[Y, w] = frdata(sys), which holds the delays."
            )
    for path, labels in names.items():
        require_d_first(labels, f"{where}: {path}")
