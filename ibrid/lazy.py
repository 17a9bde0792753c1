"""Public names of a package that are imported when they are first used."""

from collections.abc import Callable, Mapping
from importlib import import_module

from ibrid.interrupts import undisturbed


def imported_by_need(package: str, homes: Mapping[str, str]) -> Callable[[str], object]:
    """The `__getattr__` of a package. homes : public name -> module.

    No module may have a public name: importing it would put it in the name's place.
    """

    def attribute(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"{package} has no {name}")
        with undisturbed():
            return getattr(import_module(homes[name]), name)

    return attribute
