"""How an idea of control practice is put into any diagram: the view of a diagram, edits, paths, blocks in line.

From outside: `practice` (Effect, Family, Move), `view`, `edit`. Knows no idea.
"""
