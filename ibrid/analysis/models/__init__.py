"""An identified model by itself: matrices, modes, loops, predictions with bands, and how far they
hold.

From outside of `analysis`: `linear_model`, `loop_modes`, `modes`, `parametric`, `prediction`,
`residuals`, `validity`. Imports nothing else of `analysis`.
"""
