"""The interface of a kind of measured data, and small-signal sweeps as one of them.

From outside of `gap`: none.
"""
