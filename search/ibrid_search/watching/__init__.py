"""A live page about a search on this machine alone: the state of a run, and the server that shows
it.

From outside of `ibrid_search`: `watch`.
"""

from ibrid_search.watching.server import WatchServer, watch

__all__ = ["WatchServer", "watch"]
