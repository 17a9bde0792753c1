"""What finds the hidden controller: evaluated edits of a block diagram's program. `ibrid.search` runs it."""

from importlib import import_module
from typing import Any

#: Where the public names live. No module may have one of these names: importing it would put it in the name's place.
_HOME = {
    "Run": "ibrid_search.running",
    "SearchSettings": "ibrid_search.settings",
}


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted(_HOME)
    if name not in _HOME:
        raise AttributeError(f"ibrid_search has no {name}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*sorted(_HOME), "__all__"]
