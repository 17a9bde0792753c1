"""A diagram with all that follows from it, derived once: wiring, parameters, violations, canonical order and hash.

From outside: `compiled` (compile_diagram), `check` (violations, require_legal), `canonical` (structure_hash).
"""
