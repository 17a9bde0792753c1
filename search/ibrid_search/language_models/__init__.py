"""What a language model reads and writes: the language of programs, records in words, questions,
quotes.

From outside of `ibrid_search`: `context`, `model_folder`.
"""
