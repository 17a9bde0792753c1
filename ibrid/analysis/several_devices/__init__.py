"""Several devices behind one PCC: the network between them, their model, fits with some numbers
freed.

From outside of `analysis`: `collector_file`, `plant`.
"""
