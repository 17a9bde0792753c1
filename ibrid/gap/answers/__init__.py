"""From findings to the answer: verdict, sentence, evidence, where it sits, what could not be seen,
and its files.

From outside of `gap`: `files`, `result`, `simulated`, `suggesting`, `verdict`.
"""
