"""Experiments on a model: an edit tried, taken back, or in another form of delay, and how many may
be made.

From outside of `gap`: `delay_forms`.
"""
