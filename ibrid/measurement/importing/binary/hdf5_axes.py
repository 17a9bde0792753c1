"""What an HDF5 file says of the axes of an array: labels of dimensions, and scales attached to
them, as netCDF has them.
"""

import re
from typing import Any

import numpy as np

from ibrid.measurement.formats.response_labels import q_first
from ibrid.measurement.importing.binary.foreign_binary import plain_text

#: Words that say which axis of a response counts its rows (outputs), and which its columns
#: (inputs).
_ROWS = {"output", "out", "row", "response", "to", "measured"}
_COLUMNS = {
    "input",
    "in",
    "column",
    "col",
    "excitation",
    "injection",
    "injected",
    "perturbation",
    "from",
}
#: Quantities, of which the row is the current of an admittance and the voltage of an impedance.
_QUANTITIES = {"voltage", "current"}


def in_rows_and_columns(path: str, item: Any, value: np.ndarray) -> np.ndarray:
    """A stack of 2 x 2 matrices with outputs before inputs, as the file calls its axes; any other
    array as it is.

    Raises ValueError for axes that are called voltage and current, which tells no order without the
    quantity, and for an axis whose scale names q before d.
    """
    axes = [axis for axis, size in enumerate(value.shape) if size == 2]
    if len(axes) != 2 or value.ndim < 3 or value.shape != item.shape:
        return value
    names = [_name(item, axis) for axis in axes]
    for axis, name in zip(axes, names, strict=True):
        if q_first(_entries(item, axis)):
            raise ValueError(
                f"the axis {name} of {path} names q before d, exchange its entries and their names"
            )
    words = [_words(name) for name in names]
    parts = [(bool(said & _ROWS), bool(said & _COLUMNS)) for said in words]
    if not any(map(any, parts)) and any(said & _QUANTITIES for said in words):
        raise ValueError(
            f"the axes of {path} are called {' and '.join(names)}, call them output and input"
        )
    columns_first = parts[0] == (False, True) or parts[1] == (True, False)
    return np.swapaxes(value, *axes) if columns_first and parts[0] != parts[1] else value


def _name(item: Any, axis: int) -> str:
    """The label of an axis, else the name of the scale that is attached to it; its number without
    either.
    """
    scales = [scale.name.rsplit("/", 1)[-1] for scale in item.dims[axis].values()]
    return item.dims[axis].label.strip() or next(iter(scales), str(axis + 1))


def _words(name: str) -> set[str]:
    """The words of a name such as input_axis or InputAxis, small and in the singular."""
    return {word.lower().removesuffix("s") for word in re.findall("[A-Z]?[a-z]+|[A-Z]+", name)}


def _entries(item: Any, axis: int) -> list[str]:
    """How a scale of texts calls the two indices of an axis; none for numbers."""
    scales = [
        scale
        for scale in item.dims[axis].values()
        if scale.shape == (2,) and scale.dtype.kind in "SO"
    ]
    return [str(plain_text(one)) for scale in scales[:1] for one in scale[()]]
