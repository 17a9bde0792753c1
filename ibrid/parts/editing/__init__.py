"""How an idea of control practice is put into any diagram: the view of a diagram, edits, paths,
blocks in line.

From outside of `parts`: `device`, `edit`, `feedforward_path`, `paths`, `practice`, `view`.
"""
