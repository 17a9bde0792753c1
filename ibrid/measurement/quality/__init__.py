"""The first look at a measurement: coverage, passivity, wrong rows, contradictions, as facts and as text.

From outside: `inspect`, `event_inspection`, `inspection_table`, `wrong_rows`.
"""
