"""Values that are said to be frozen are so throughout: mappings, sequences and arrays in them
cannot be changed either.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NoReturn

import numpy as np


class FrozenDict(dict):
    """A dictionary that cannot be changed.

    It is pickled, copied, compared and written as any other; `dict(it)` is free again.
    """

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError(
            "this belongs to a frozen value, which nobody changes; change a copy, made by dict(...)"
        )

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse  # type: ignore[assignment]

    def __reduce__(self) -> tuple[type, tuple[dict]]:
        return FrozenDict, (dict(self),)


class FrozenList(list):
    """A list that cannot be changed, in all else as any other; `list(it)` is free again."""

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise TypeError(
            "this belongs to a frozen value, which nobody changes; change a copy, made by list(...)"
        )

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse  # type: ignore[assignment]
    append = extend = insert = remove = pop = clear = sort = reverse = _refuse  # type: ignore[assignment]

    def __reduce__(self) -> tuple[type, tuple[list]]:
        return FrozenList, (list(self),)


def sealed(array: np.ndarray) -> np.ndarray:
    """A copy over bytes, which nothing makes writable again, in the order of C.

    Elements that are Python objects have no bytes: their array is a view that is not writable.
    """
    if array.dtype.hasobject or not array.size:
        array = array.view()
        array.flags.writeable = False
        return array
    return np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape)


def frozen(value: Any) -> Any:
    """The same as mappings, sequences and arrays that cannot be changed; what is none of these
    stays as it is.
    """
    if isinstance(value, FrozenDict | FrozenList):
        return value
    if isinstance(value, Mapping):
        return FrozenDict((key, frozen(entry)) for key, entry in value.items())
    if type(value) in (list, tuple):
        return (FrozenList if type(value) is list else tuple)(frozen(entry) for entry in value)
    if isinstance(value, np.ndarray) and value.flags.writeable:
        return sealed(value)
    return value


class Frozen:
    """Base of a frozen dataclass whose fields hold mappings, sequences or arrays."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]
            object.__setattr__(self, field.name, frozen(getattr(self, field.name)))

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Arrays can be changed again when they come back from a pickle."""
        for name, value in state.items():
            object.__setattr__(self, name, frozen(value))
