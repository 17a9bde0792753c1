"""Voltage and current in time at the terminals: the rest, the event, the samples and what lies between them.

From outside: `events` (Events, EventRecord), `event_windows`, `fixed_steps`, `transformed`.
"""
