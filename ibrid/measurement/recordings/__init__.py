"""Voltage and current in time at the terminals: the rest, the event, the samples and what lies
between them.

From outside of `measurement`: `between_samples`, `dq_pairs`, `event_rest`, `event_windows`,
`events`, `fixed_steps`, `resampling`, `transformed`.
"""
