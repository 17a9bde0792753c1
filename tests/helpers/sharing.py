"""Results that tests share: made once in a process, and charged to every test that asks for them.

Neither what a test costs nor how it ends may depend on which test came first: conftest adds `borrowed` to what it measured
itself, and fails a test that leaves a shared result other than it got it (`changed_results`).
"""

import inspect
import os
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import wraps
from hashlib import sha256
from typing import Any, ParamSpec, TypeVar

import numpy as np

from ibrid.structure.diagrams.diagram import Diagram

P = ParamSpec("P")
T = TypeVar("T")
#: Processor seconds of shared results that earlier tests made and the running one asked for; conftest empties it.
borrowed: dict[Hashable, float] = {}
#: Every shared result of this process: its name, itself, and the digest of what it was when it was made.
_results: dict[Hashable, tuple[str, Any, str]] = {}


def processor_seconds() -> float:
    """Of this process and its ended children, in s: other work on the machine does not change it."""
    now = os.times()
    return now.user + now.system + now.children_user + now.children_system


def shared(function: Callable[P, T]) -> Callable[P, T]:
    """As functools.cache, with the seconds it took charged to each later caller."""
    made: dict[Hashable, tuple[T, float]] = {}
    signature = inspect.signature(function)

    @wraps(function)
    def asked(*args: P.args, **options: P.kwargs) -> T:
        given = signature.bind(*args, **options)
        given.apply_defaults()
        key = (given.args, tuple(sorted(given.kwargs.items())))
        if key in made:
            borrowed.setdefault((asked, key), made[key][1])
        else:
            began = processor_seconds()
            made[key] = (function(*args, **options), processor_seconds() - began)
            borrowed[asked, key] = 0.0  # paid by whoever made it
            _results[asked, key] = (f"{function.__name__}{key[0]}", made[key][0], digest(made[key][0]))
        return made[key][0]

    return asked


def changed_results() -> list[str]:
    """Names of the shared results that the running test asked for and changed; a later test would read another value."""
    asked_for = [_results[key] for key in borrowed if key in _results]
    return [name for name, value, was in asked_for if digest(value) != was]


def digest(value: Any) -> str:
    """Of every number, text and array of a value; what an object keeps beside its fields, such as a cache, does not count."""
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
