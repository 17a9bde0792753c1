"""Fitting bounded parameters: problem, seeds, compiled Gauss-Newton, Ipopt, identifiability."""
