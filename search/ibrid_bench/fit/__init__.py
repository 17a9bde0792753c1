"""`make bench`: the figures that the project holds itself to, each beside what it is compared
with.
"""
