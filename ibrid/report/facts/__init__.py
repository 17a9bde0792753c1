"""What pages and texts say, computed once: the verdict, modes, words of a gap, rows of parameters.

From outside of `report`: `bases`, `parameter_rows`, `verdict`.
"""
