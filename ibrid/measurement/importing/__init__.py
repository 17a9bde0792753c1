"""Files of others: which column is which, what their names and comments say, and what must be
asked.

From outside of `measurement`: `foreign_table`, `importing`, `numbers`, `timed`, `told`, `unsaid`.
"""
