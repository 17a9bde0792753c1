"""Ideas about what is built and what drives it: filter, converter, the way of the command, damping.

From outside: nothing; `parts.catalogue` lists them.
"""
