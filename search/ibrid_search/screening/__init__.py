"""Screening of structural edits: a short descent of each candidate, ranked by an information
criterion, and the criterion by which fitted candidates are compared.

From outside of `ibrid_search`: `plausibility`.
"""
