"""Generic models of planning programs (WECC, second generation): their blocks, laws and files, and
how they are fitted to recordings.
"""
