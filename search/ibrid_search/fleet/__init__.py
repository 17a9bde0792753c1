"""Hundreds to thousands of devices: each examined by one job, what the fleet has in common known
beforehand to the next.

From outside of `ibrid_search`: `running`.
"""
