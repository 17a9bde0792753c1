"""How a value shows itself: pages, figures and tables lie above the values they show, so they are
imported when asked for.
"""

from importlib import import_module
from typing import Any

from ibrid.foreign_text import show_controls
from ibrid.interrupts import undisturbed

#: Characters of a value in a line.
LONGEST = 200


def brief(text: str, end: str = "") -> str:
    """A line of at most `LONGEST` characters, shortened before its end."""
    text = show_controls(text)
    room = LONGEST - len(end)
    return (text if len(text) <= room else f"{text[: room - 1].rstrip()}…") + end


def shown(value: Any, module: str, function: str, *options: Any) -> Any:
    """What a function of `ibrid.report` makes of a value."""
    return made_above(value, f"ibrid.report.{module}", function, *options)


def made_above(value: Any, module: str, function: str, *options: Any) -> Any:
    """What a function of a module, which imports the value's own, makes of a value."""
    with undisturbed():
        home = import_module(module)
    return getattr(home, function)(value, *options)
