"""The rules that make a diagram legal, one file for each kind, and the order in which they are
asked.

From outside of `structure`: `algebraic_loops`, `grammar`, `violation`.
"""
