"""A diagram read against a vocabulary: what drives each input, which numbers are free, what stands still.

From outside: `wiring` (wire, Wiring), `parameters` (parameter_table).
"""
