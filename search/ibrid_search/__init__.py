"""What finds the hidden controller: evaluated edits of a block diagram's program. `ibrid.search` runs it."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # what `_HOME` does, for those who read types; a test compares them
    from ibrid_search.proposers.choose import Proposers
    from ibrid_search.running import Run
    from ibrid_search.settings import Goal, SearchSettings, Workers
    from ibrid_search.spending import Limits

__all__ = ["Goal", "Limits", "Proposers", "Run", "SearchSettings", "Workers"]

#: Where the public names live. No module may have one of these names: importing it would put it in the name's place.
_HOME = {
    "Goal": "ibrid_search.settings",
    "Limits": "ibrid_search.spending",
    "Proposers": "ibrid_search.proposers.choose",
    "Run": "ibrid_search.running",
    "SearchSettings": "ibrid_search.settings",
    "Workers": "ibrid_search.settings",
}


if not TYPE_CHECKING:  # with it every misspelt name would have the type Any

    def __getattr__(name: str) -> object:
        if name not in _HOME:
            raise AttributeError(f"ibrid_search has no {name}")
        return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__all__"]
