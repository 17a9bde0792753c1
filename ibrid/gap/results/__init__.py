"""What `find_gap` returns: verdict and its sentence, named effects with evidence, located misfit,
undetectable effects, and the files that are written.

From outside of `gap`: `files`, `gap`, `simulated_sweep`, `suggested_edits`, `verdict`.
"""
