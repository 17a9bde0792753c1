"""A device that is a model file, opened: measure, identify, ask what to measure next, measure that.

From outside of `ibrid_search`: none.
"""
