"""Results that tests share: made once in a process.

How a test ends may not depend on which test came first: conftest fails one that leaves a shared
result other than it got it (`changed_results`).
"""

import inspect
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import wraps
from hashlib import sha256
from typing import Any, ParamSpec, TypeVar

import numpy as np

from ibrid.structure.diagrams.diagram import Diagram

P = ParamSpec("P")
T = TypeVar("T")
#: Shared results that the running test asked for; conftest empties it.
asked_for: set[Hashable] = set()
#: Every shared result of this process: its name, itself, and the digest of what it was when it was
#: made.
_results: dict[Hashable, tuple[str, Any, str]] = {}


def shared(function: Callable[P, T]) -> Callable[P, T]:
    """As functools.cache, of arguments however they are written, for results that a test may not
    change.
    """
    made: dict[Hashable, T] = {}
    signature = inspect.signature(function)

    @wraps(function)
    def asked(*args: P.args, **options: P.kwargs) -> T:
        given = signature.bind(*args, **options)
        given.apply_defaults()
        key = (given.args, tuple(sorted(given.kwargs.items())))
        asked_for.add((asked, key))
        if key not in made:
            made[key] = function(*args, **options)
            _results[asked, key] = (f"{function.__name__}{key[0]}", made[key], digest(made[key]))
        return made[key]

    return asked


def changed_results() -> list[str]:
    """Names of the shared results that the running test asked for and changed; a later test would
    read another value.
    """
    results = (_results[key] for key in asked_for if key in _results)
    return [name for name, value, was in results if digest(value) != was]


def digest(value: Any) -> str:
    """Of every number, text and array of a value; what an object keeps beside its fields, such as a
    cache, does not count.
    """
    hashed = sha256()
    for part in _parts(value):
        hashed.update(part)
        hashed.update(b"\0")
    return hashed.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        yield repr((value.dtype.str, value.shape)).encode()
        yield repr(value.tolist()).encode() if value.dtype.hasobject else value.tobytes()
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield repr(key).encode()
            yield from _parts(inner)
    elif isinstance(value, list | tuple):
        yield str(len(value)).encode()
        for inner in value:
            yield from _parts(inner)
    elif isinstance(value, Diagram):
        yield from _parts([*value.instances, *value.connections])
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield field.name.encode()
            yield from _parts(getattr(value, field.name))
    elif isinstance(value, str | bytes | int | float | complex | np.generic | None):
        yield repr(value).encode()
    else:  # functions, types, and objects that tell nothing of themselves
        yield type(value).__name__.encode()
