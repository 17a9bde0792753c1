"""Ideas about the loops of power, droops and references.

From outside of `parts`: nothing.
"""
