"""Frequency responses: the 2x2 dq admittance per operating point, at several amplitudes, and how noisy it is.

From outside: `sweep` (Sweep, PointSweep, OperatingPoint), `noise`, `amplitudes`, `linearity`. Imports nothing else of
`measurement`.
"""
