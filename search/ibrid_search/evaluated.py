"""A candidate that was evaluated, and how far an edit of it may reach."""

from dataclasses import dataclass

from ibrid.evaluation.record import Record
from ibrid.structure.diagrams.diagram import Diagram

#: How far an edit reaches: sharing and wires; one component; a plant or a whole sub-loop.
SCALES = ("local", "module", "structural")


@dataclass(frozen=True)
class Evaluated:
    """A valid candidate with its record."""

    step: int
    diagram: Diagram
    record: Record
