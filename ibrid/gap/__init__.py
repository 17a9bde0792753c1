"""Where a model and measured data disagree: the catalogue of effects that may be missing, and how
one is found.
"""
