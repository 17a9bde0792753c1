"""Experiments on a model: an edit tried, taken back, or in another form of delay, and how many may be made.

From outside: `data` (the kinds of data a gap is sought in), `trial`, `budget`.
"""
