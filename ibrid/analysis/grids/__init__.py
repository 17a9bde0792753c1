"""An identified inverter in a grid: closed-loop poles, the Nyquist criterion, critical ratios, power Jacobian.

From outside: `stability`, `power_jacobian`, `grid`.
"""
