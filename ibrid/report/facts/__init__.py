"""What pages and texts say, computed once: the verdict, modes, words of a gap, rows of parameters.

From outside of `report`: `bases`, `left_over`, `parameter_rows`, `verdict`.
"""
