"""The process in which a model file of somebody else runs: how it is started, asked and ended, and
what it reads.

From outside of `devices`: `process`.
"""
