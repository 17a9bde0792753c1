"""Results that tests share: made once in a process, and charged to every test that asks for them.

What a test costs must not depend on which test came first; conftest adds `borrowed` to what it measured itself.
"""

import os
from collections.abc import Callable, Hashable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
#: Processor seconds of shared results that earlier tests made and the running one asked for; conftest empties it.
borrowed: dict[Hashable, float] = {}


def processor_seconds() -> float:
    """Of this process and its ended children, in s: other work on the machine does not change it."""
    now = os.times()
    return now.user + now.system + now.children_user + now.children_system


def shared(function: Callable[P, T]) -> Callable[P, T]:
    """As functools.cache, with the seconds it took charged to each later caller."""
    made: dict[Hashable, tuple[T, float]] = {}

    @wraps(function)
    def asked(*args: P.args, **options: P.kwargs) -> T:
        key = (args, tuple(sorted(options.items())))
        if key in made:
            borrowed.setdefault((asked, key), made[key][1])
        else:
            began = processor_seconds()
            made[key] = (function(*args, **options), processor_seconds() - began)
            borrowed[asked, key] = 0.0  # paid by whoever made it
        return made[key][0]

    return asked
