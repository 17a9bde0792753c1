"""A diagram with all that follows from it, derived once: wiring, parameters, violations, canonical
order and hash.

From outside of `structure`: `canonical`, `check`, `compiled`.
"""
