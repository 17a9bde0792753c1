"""Ideas about the loops of power, droops and references.

From outside: nothing; `parts.catalogue` lists them.
"""
