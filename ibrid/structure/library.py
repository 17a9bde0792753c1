"""The textbook diagrams that ship as program files."""

from importlib.resources import files

from ibrid.errors import ProgramError, near
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import parse_program


def textbook_names() -> tuple[str, ...]:
    """Names of the shipped programs."""
    folder = files("ibrid.structure") / "programs"
    return tuple(sorted(entry.name.removesuffix(".py") for entry in folder.iterdir() if entry.name.endswith(".py")))


def textbook_text(name: str) -> str:
    """Program text of a textbook diagram; ProgramError with near names otherwise."""
    if name not in textbook_names():
        raise ProgramError(f"no textbook diagram is called {name!r}; {near(name, textbook_names())}")
    return (files("ibrid.structure") / "programs" / f"{name}.py").read_text(encoding="utf-8")


def textbook(name: str) -> Diagram:
    """A textbook diagram by name, such as "naive" or "gfl"."""
    return parse_program(textbook_text(name), f"textbook {name}")
