"""Ideas about what is built and what drives it: filter, converter, the way of the command, damping.

From outside of `parts`: `delay_form`, `nonlinear`, `output_filter`.
"""
