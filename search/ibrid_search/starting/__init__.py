"""The first result for a data set: which library diagram explains it, how well, and what to do
next.

From outside of `ibrid_search`: none.
"""
