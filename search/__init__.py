"""search: find the hidden controller, from a naive block diagram, by evaluated edits of its program.

run = search.run(ibrid.read_sweep("data/paper_like.csv"), "out/run", budget=200)
print(run.best.program)
"""

from importlib import import_module
from typing import Any

#: Where the public names live. No module may have one of these names: importing it would put it in the name's place.
_HOME = {
    "LearningSettings": "search.learning.settings",
    "Run": "search.running",
    "SearchSettings": "search.settings",
    "run": "search.running",
}


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return sorted(_HOME)
    if name not in _HOME:
        raise AttributeError(f"search has no {name}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*sorted(_HOME), "__all__"]
