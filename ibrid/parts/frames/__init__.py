"""Ideas about how a controller gets its frame: synchronisation, what stands in front of a PLL,
sequences.

From outside of `parts`: `pll_static_error`.
"""
