"""Events whose missing effect is known: devices simulated apart from everything in the package, and
how often it is named.
"""
