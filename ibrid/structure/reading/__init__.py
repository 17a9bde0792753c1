"""A diagram read against a vocabulary: what drives each input, which numbers are free, what stands
still.

From outside of `structure`: `parameters`, `steady_state`, `wiring`.
"""
