"""Processor seconds of the main jobs on inputs of the size that people have.

`jobs` : what is measured. `beside` : the same inputs by other libraries. `sensitivity` : what each
setting of a fit is worth.
"""
