"""Files of others: which column is which, what their names and comments say, and what must be
asked.

From outside of `measurement`: `importing`, `timed`, `told`, `unsaid`.
"""
