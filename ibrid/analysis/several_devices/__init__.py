"""Several devices behind one PCC: the network between them, their model, fits with some numbers freed.

From outside: `collector`, `collector_file`, `plant`, `freed_fits`.
"""
