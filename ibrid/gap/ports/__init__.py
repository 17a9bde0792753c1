"""One unknown transfer at one port of a diagram: the places, the fit with it left open, the map of
them all.

From outside of `gap`: `missing_transfer`, `port_map`.
"""
