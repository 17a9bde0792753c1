"""An identified model by itself: matrices, modes, loops, predictions with bands, and how far they hold.

From outside: `linear_model`, `modes`, `prediction` (predict). Imports nothing else of `analysis`.
"""
