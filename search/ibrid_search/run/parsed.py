"""Diagrams of the programs of a run, read once each; objects of JSON."""

from functools import lru_cache
from typing import Any

from ibrid.foreign_data import json_in
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program


@lru_cache(maxsize=1024)
def parsed(program: str) -> Diagram:
    """The diagram of a program, shared by all who ask and changed by none. Raises ProgramError."""
    return parse_program(program, "the edited program")


def mapping_in(text: str) -> dict[str, Any]:
    """The object that a text of JSON holds; empty where it holds none."""
    try:
        found = json_in(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
