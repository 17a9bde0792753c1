"""Frequency responses: the 2x2 dq admittance per operating point, at several amplitudes, and how
noisy it is.

From outside of `measurement`: `amplitudes`, `frequencies`, `interpolating`, `linearity`, `noise`,
`operating_points`, `quantities`, `sweep`. Imports nothing else of `measurement`.
"""
