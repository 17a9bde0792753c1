"""What pages, texts and figures say, computed once: numbers, words and rows.

From outside: `numbers`, `verdict`.
"""
