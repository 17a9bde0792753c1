"""Devices in which an effect is hidden, measured: what the gap workflow is tested on.

A program of its own: nonlinear equations, exact delays and its own parameters. It shares no code
with the assembly of block diagrams, their fit, the vocabulary or the gap workflow; it only writes
program text that they read.
"""
