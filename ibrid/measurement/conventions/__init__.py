"""How numbers are meant: bases, signs, axes, frames and frequencies; what a file says of them, and
what contradicts it.

From outside of `measurement`: `contradictions`, `frequency_base`, `header`, `labels`,
`positive_sequence`, `rotation`, `tail`.
"""
