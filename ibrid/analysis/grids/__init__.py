"""An identified inverter in a grid: closed-loop poles, the Nyquist criterion, critical ratios,
power Jacobian.

From outside of `analysis`: `grid`, `power_jacobian`, `series_grid`, `stability`.
"""
