"""What the grammar says of a diagram, asked once for each program of a run."""

from functools import cached_property

from ibrid.errors import DiagramError
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.canonical import structure_hash
from ibrid.structure.check import examine
from ibrid.structure.diagram import Diagram
from ibrid.structure.violation import Violation

#: Programs that are remembered.
REMEMBERED = 4096


class Examined:
    """`hash` : of the structure, "" where a kind or port does not exist. `violations`, `warnings` : of the grammar, which
    is slower and therefore asked only when they are wanted."""

    def __init__(self, diagram: Diagram, kinds: Vocabulary, equilibrium: str) -> None:
        self._diagram, self._kinds, self._equilibrium = diagram, kinds, equilibrium

    @cached_property
    def hash(self) -> str:
        try:
            return structure_hash(self._diagram, self._kinds, equilibrium=self._equilibrium)
        except DiagramError:
            return ""  # the grammar says which

    @property
    def violations(self) -> tuple[Violation, ...]:
        return self._found[0]

    @property
    def warnings(self) -> tuple[Violation, ...]:
        return self._found[1]

    @cached_property
    def _found(self) -> tuple[tuple[Violation, ...], tuple[Violation, ...]]:
        return examine(self._diagram, self._kinds, equilibrium=self._equilibrium)


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
            self._known[text] = Examined(diagram, self._kinds, self._equilibrium)
        return self._known[text]
