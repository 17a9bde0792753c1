"""Control practice: one file for each idea, how it is put into any diagram, taken out and
exchanged, how strong it usually is, where in frequency it shows. The gap reads effects from it, the
search families of moves.
"""

from ibrid.parts.catalogue import CATALOGUE, FAMILIES, insertions
from ibrid.parts.editing.edit import Edit, Strength
from ibrid.parts.editing.practice import Effect, Family, Insertion
from ibrid.parts.editing.view import Move, View, view_of, views_of

__all__ = [
    "CATALOGUE",
    "FAMILIES",
    "Edit",
    "Effect",
    "Family",
    "Insertion",
    "Move",
    "Strength",
    "View",
    "insertions",
    "view_of",
    "views_of",
]
