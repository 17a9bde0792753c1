"""Models in files of others: state spaces, and MATLAB's objects.

From outside of `importing`: `state_spaces`.
"""
