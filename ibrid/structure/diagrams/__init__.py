"""Named modules and connections, their program text, and the diagrams that ship.

From outside of `structure`: `diagram`, `library`, `program`.
"""
