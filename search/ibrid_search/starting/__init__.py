"""A first answer before any search: which shipped diagram explains the data, and of which family.

From outside of `ibrid_search`: `start`.
"""
