"""What the grammar says of a diagram, asked once for each program of a run."""

from dataclasses import dataclass

from ibrid.errors import DiagramError
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.canonical import structure_hash
from ibrid.structure.check import examine
from ibrid.structure.diagram import Diagram
from ibrid.structure.violation import Violation

#: Programs that are remembered.
REMEMBERED = 4096


@dataclass(frozen=True)
class Examined:
    """`hash` : of the structure, "" where a kind or port does not exist. `violations`, `warnings` : of the grammar."""

    hash: str
    violations: tuple[Violation, ...]
    warnings: tuple[Violation, ...]


class Examination:
    """The grammar of a run with a memory: proposers ask it about many edits, and it is asked again about the chosen one."""

    def __init__(self, kinds: Vocabulary, equilibrium: str) -> None:
        self._kinds, self._equilibrium = kinds, equilibrium
        self._known: dict[str, Examined] = {}

    def __call__(self, diagram: Diagram, text: str) -> Examined:
        """What is to be said of a diagram whose canonical print is `text`."""
        if text not in self._known:
            if len(self._known) >= REMEMBERED:
                self._known.clear()
            self._known[text] = self._examined(diagram)
        return self._known[text]

    def _examined(self, diagram: Diagram) -> Examined:
        try:
            digest = structure_hash(diagram, self._kinds, equilibrium=self._equilibrium)
        except DiagramError:
            digest = ""  # a kind or port that does not exist: the grammar says which
        return Examined(digest, *examine(diagram, self._kinds, equilibrium=self._equilibrium))
