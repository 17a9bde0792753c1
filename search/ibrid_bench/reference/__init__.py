"""Every reference inverter measured in every way: its sweeps, its textbook program, the search and
the gap workflow.
"""
