"""Public names of a package that are imported when they are first used; and packages that look for
settings in the working folder, which is often somebody else's and decides nothing.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from ibrid.interrupts import undisturbed

#: What matplotlib and numba look for in the working folder; numba at each compilation again.
MATPLOTLIB, NUMBA = "matplotlibrc", ".numba_config.yaml"


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


@contextmanager
def without_settings(file: str) -> Iterator[None]:
    """Within, which is for an import, the working folder is another one if it holds that file."""
    if not os.path.exists(file):
        yield
        return
    folder = os.getcwd()
    os.chdir(Path(__file__).parent)
    try:
        yield
    finally:
        os.chdir(folder)
