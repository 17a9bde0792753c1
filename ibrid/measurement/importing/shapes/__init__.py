"""Tables of other shapes as one with four entries in a row: long ones, more ports, the steady state
in d and q.

From outside of `importing`: `signed_names`.
"""
