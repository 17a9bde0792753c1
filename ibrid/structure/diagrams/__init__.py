"""Named modules and connections, their program text, and the diagrams that ship.

From outside: `diagram` (Diagram), `program` (parse, print), `library` (textbook).
"""
