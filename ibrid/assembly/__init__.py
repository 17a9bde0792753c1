"""From a diagram to its matrices: the operating point, python-control systems and CasADi
functions.
"""
