"""The rules that make a diagram legal, one file for each kind, and the order in which they are asked.

From outside: `violation`, `devices`; whoever asks whether a diagram is legal asks `compiling.check`.
"""
