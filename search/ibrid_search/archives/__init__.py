"""Islands, elites and eviction; what evaluated candidates are worth, and what finished runs teach.

From outside of `ibrid_search`: `experience`.
"""
