"""What a language model reads and writes: the language of programs, records in words, questions, quotes.

From outside: nothing but `proposers` and `agents`.
"""
