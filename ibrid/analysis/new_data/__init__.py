"""What new data say of a known device, and which data would say most.

From outside of `analysis`: `drift`, `event_answers`, `experiments`.
"""
