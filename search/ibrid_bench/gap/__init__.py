"""`make bench-gap`: devices in which an effect is hidden, and how often the gap workflow finds and
names it.
"""
