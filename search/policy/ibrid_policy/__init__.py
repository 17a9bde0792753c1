"""A small policy of our own: it reads a diagram and its residuals, and writes an edit. Needs torch
only to sample or train.
"""
