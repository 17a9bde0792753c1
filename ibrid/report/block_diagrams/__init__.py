"""The block diagram as a picture: what is on it, where it lies, how its lines run.

From outside of `report`: `block_diagram`.
"""
