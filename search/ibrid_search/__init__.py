"""What finds the hidden controller: evaluated edits of a block diagram's program. `ibrid.search`
runs it.
"""

from typing import TYPE_CHECKING

from ibrid.lazy import imported_by_need

if TYPE_CHECKING:  # the same names for type checkers, which a test compares
    from ibrid_search.chat.spending import Limits
    from ibrid_search.proposers.choose import Proposers
    from ibrid_search.running import Run
    from ibrid_search.settings import Goal, SearchSettings, Workers

__all__ = ["Goal", "Limits", "Proposers", "Run", "SearchSettings", "Workers"]

#: Public name -> the module that it is imported from when it is first used.
HOMES = {
    "Goal": "ibrid_search.settings",
    "Limits": "ibrid_search.chat.spending",
    "Proposers": "ibrid_search.proposers.choose",
    "Run": "ibrid_search.running",
    "SearchSettings": "ibrid_search.settings",
    "Workers": "ibrid_search.settings",
}

if not TYPE_CHECKING:  # with it every misspelt name would have the type Any
    __getattr__ = imported_by_need(__name__, HOMES)


def __dir__() -> list[str]:
    return [*__all__, "__all__"]
