"""Voltage and current in time: what they are judged by, the fit of a diagram with limits, and the race of missing limits.

From outside: `records` (a kind of `trials.data`), `event_question`, `joint_fit` (evaluate_events).
"""
