"""The first look at a measurement: coverage, passivity, wrong rows, contradictions, as facts and as
text.

From outside of `measurement`: `coverage`, `event_contradictions`, `event_inspection`, `inspect`,
`inspection_table`, `other_readings`, `passivity`, `plausibility`, `sequence_view`,
`shifted_entries`, `wrong_rows`.
"""
