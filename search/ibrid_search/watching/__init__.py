"""A live page about a search on this machine alone: the state of a run, and the server that shows it.

From outside: `watch`, by `ibrid.commands` alone.
"""

from ibrid_search.watching.server import WatchServer, watch

__all__ = ["WatchServer", "watch"]
