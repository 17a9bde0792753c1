"""Test-time reinforcement learning: the rewards of a search train its proposer on the way (paper,
section V.C).
"""
