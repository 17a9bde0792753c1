"""How numbers are meant: bases, signs, axes, frames and frequencies; what a file says of them, and what contradicts it.

From outside: `conversions` and `header` for whoever reads a file, `contradictions` and `labels` for whoever doubts one.
"""
