"""A diagram being edited: modules and wires put in and taken out, frames, and the loops and roles
an engineer sees.

From outside of `structure`: `drafting`, `frames`, `loops`, `roles`.
"""
