"""Pictures: curves, modes, the course of a search, and the style that all share. The only place that draws.

From outside: `plotting`, which objects' `.plot` calls.
"""
