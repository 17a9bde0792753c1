"""One unknown transfer at one port of a diagram: the places, the fit with it left open, the map of them all.

From outside: `port_map`, `missing_transfer`.
"""
