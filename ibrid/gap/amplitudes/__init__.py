"""Sweeps at several injection amplitudes: which nonlinearity at which port explains them, by
harmonic balance.

From outside of `gap`: `port_gain`.
"""
