"""Files that say exactly what they hold: the project's CSV, Touchstone, PSCAD text, state space, python-control.

From outside: `csv_file`, `event_csv`, `frd`, `files`; a new format is one file here and a line in `measurement.read`.
"""
