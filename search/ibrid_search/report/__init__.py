"""The page about a run: its sections, and `page`, which puts them together; that of a fleet, too.

From outside of `ibrid_search`: `page`.
"""
