"""How others write numbers: which mark is the decimal one, in which unit polar cells have their
angles, and what is said of it.
"""
