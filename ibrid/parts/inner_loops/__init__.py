"""Ideas about the loops of current and voltage: measurement, decoupling, feedforward, virtual
impedance.

From outside of `parts`: `current_voltage_loops`.
"""
