"""The diagrams that ship as program files: the textbook ones, and published controls with typical
values.
"""

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

from ibrid.border import takes_kinds
from ibrid.errors import ProgramError, near
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program

_ROOM = files("ibrid.structure")
_TEXTBOOK, _PUBLISHED = _ROOM / "programs", _ROOM / "published"


@cache
def textbook_names() -> tuple[str, ...]:
    """Names of the textbook programs."""
    return _names(_TEXTBOOK)


@cache
def published_names() -> tuple[str, ...]:
    """Names of the programs of published controls."""
    return _names(_PUBLISHED)


@cache
def shipped_names() -> tuple[str, ...]:
    """Names of both, the textbook ones first."""
    return (*textbook_names(), *published_names())


@takes_kinds
def textbook_text(name: str) -> str:
    """Program text of a shipped diagram; ProgramError with near names otherwise."""
    for folder, names in ((_TEXTBOOK, textbook_names()), (_PUBLISHED, published_names())):
        if name in names:
            return (folder / f"{name}.py").read_text(encoding="utf-8")
    raise ProgramError(f"no textbook diagram is called {name!r}; {near(name, shipped_names())}")


@takes_kinds
def textbook(name: str) -> Diagram:
    """A shipped diagram by name, textbook or published, such as "naive", "gfl" or
    "gfl_dsogi_pll".
    """
    return parse_program(textbook_text(name), f"textbook {name}")


@takes_kinds
def published_values(name: str) -> Mapping[str, float]:
    """Typical values of a published control where they are others than those of its kinds, per
    unit, s and rad/s.

    With them, and the typical values of the kinds for the rest, it is stable behind a grid of a
    short-circuit ratio of 5.
    """
    return json.loads((_PUBLISHED / "values.json").read_text(encoding="utf-8"))[name]


def _names(folder) -> tuple[str, ...]:
    return tuple(
        sorted(
            entry.name.removesuffix(".py")
            for entry in folder.iterdir()
            if entry.name.endswith(".py")
        )
    )
