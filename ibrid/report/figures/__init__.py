"""Pictures: Bode plots, curves and ports of a gap, the course of a search.

From outside of `report`: `bode`, `trajectory`.
"""
