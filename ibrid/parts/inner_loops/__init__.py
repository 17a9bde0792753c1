"""Ideas about the loops of current and voltage: measurement, decoupling, feedforward, virtual impedance.

From outside: nothing; `parts.catalogue` lists them.
"""
