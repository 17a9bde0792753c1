"""Files that say exactly what they hold: the project's CSV, Touchstone, PSCAD text, state space,
python-control.

From outside of `measurement`: `bundle`, `csv_file`, `event_csv`, `files`, `frd`, `model_poles`,
`state_space_file`, `touchstone`. A new format is one file here and a line in `measurement.read`.
"""
