"""Waveform recordings: their noise, the fit of a diagram with limits, and the screening of missing
limits and of edits.

From outside of `gap`: `event_fitter`, `event_misfit`, `event_noise`, `event_problem`,
`evaluation_record`, `event_evaluation`, `successive_halving`.
"""
