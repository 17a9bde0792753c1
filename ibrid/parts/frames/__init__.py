"""Ideas about how a controller gets its frame: synchronisation, what stands in front of a PLL, sequences.

From outside: nothing; `parts.catalogue` lists them.
"""
