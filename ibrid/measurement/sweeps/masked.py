"""Masked arrays of NumPy, in which some numbers are marked as not measured."""

from typing import Any

import numpy as np

from ibrid.errors import SweepError


def require_unmasked(what: str, values: Any) -> None:
    """Raise SweepError, beginning with `what`, where an array, or one in a list, masks a number:
    np.asarray would measure it.
    """
    if isinstance(values, list | tuple):
        for value in values:
            require_unmasked(what, value)
    elif count := int(np.ma.count_masked(values)) if isinstance(values, np.ma.MaskedArray) else 0:
        raise SweepError(
            f"{what} must have no masked numbers, which were not measured; found {count}, leave "
            "out those frequencies or samples."
        )
