"""Models in files of others: state spaces, transfer functions, and MATLAB's objects.

From outside of `importing`: `state_spaces`.
"""
