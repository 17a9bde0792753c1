"""Diagrams of the programs of a run, read once each."""

from functools import lru_cache

from ibrid.structure.diagram import Diagram
from ibrid.structure.program import parse_program


@lru_cache(maxsize=1024)
def parsed(program: str) -> Diagram:
    """The diagram of a program, shared by all who ask and changed by none. Raises ProgramError."""
    return parse_program(program, "the edited program")
