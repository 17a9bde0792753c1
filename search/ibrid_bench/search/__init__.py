"""`make bench-search`: hidden inverters, and how often, how fast and how well the search finds
them.
"""
