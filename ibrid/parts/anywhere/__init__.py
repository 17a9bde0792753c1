"""Edits that belong to no idea: a block on any wire, a sign, a wire, a shared parameter.

From outside of `parts`: `blocks`, `wiring`.
"""
