"""Estimators of phasors and rms values: their windows, what they make of a voltage that jumps, and
of white noise.

From outside of `measurement`: `window`, `correlation`.
"""
