"""What a small language model answers to the questions of a search: free, within the grammar of
edits, and after learning.
"""
