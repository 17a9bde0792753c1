"""A run on disk: the folder, the database of its steps, and what follows from these alone.

From outside of `ibrid_search`: `parsed`, `run_folder`, `store`.
"""
