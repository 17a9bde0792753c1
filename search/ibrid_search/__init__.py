"""What finds the hidden controller: evaluated edits of a block diagram's program. `ibrid.search` runs it."""

from typing import TYPE_CHECKING

from ibrid.lazy import imported_by_need

if TYPE_CHECKING:  # read by type checkers, and by `imported_by_need`
    from ibrid_search.chat.spending import Limits
    from ibrid_search.proposers.choose import Proposers
    from ibrid_search.running import Run
    from ibrid_search.settings import Goal, SearchSettings, Workers

__all__ = ["Goal", "Limits", "Proposers", "Run", "SearchSettings", "Workers"]

if not TYPE_CHECKING:  # with it every misspelt name would have the type Any
    __getattr__ = imported_by_need(__name__)


def __dir__() -> list[str]:
    return [*__all__, "__all__"]
