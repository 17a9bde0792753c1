"""The answer of a run, and the structures that the data cannot tell from it.

From outside of `ibrid_search`: `rivals`.
"""
