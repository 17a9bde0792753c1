"""The grammar: is a diagram legal, and if not, why, where, and what would mend it (paper, section
IV, A.1).
"""

from collections.abc import Sequence

from ibrid.border import takes_kinds
from ibrid.errors import DiagramError
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.compiling.compiled import CompiledDiagram, compile_diagram
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.grammar_rules.violation import Violation

__all__ = ["Violation", "require_legal", "violations", "warnings"]

#: Violations that an error tells.
SHOWN = 8


@takes_kinds
def violations(
    diagram: Diagram,
    vocabulary: str | Sequence[ModuleKind] = "extended",
    *,
    equilibrium: str = "exact",
) -> tuple[Violation, ...]:
    """Every breach of the grammar, by line; empty for a legal diagram.

    Whether loops can be solved and operating points be found is asked once all else is right.
    Raises DiagramError for an unknown vocabulary or equilibrium mode.
    """
    return compile_diagram(diagram, vocabulary, equilibrium=equilibrium).violations


@takes_kinds
def warnings(
    diagram: Diagram,
    vocabulary: str | Sequence[ModuleKind] = "extended",
    *,
    equilibrium: str = "exact",
) -> tuple[Violation, ...]:
    """What is legal but probably a mistake, by line; empty for a diagram that is not legal."""
    return compile_diagram(diagram, vocabulary, equilibrium=equilibrium).warnings


def examine(
    diagram: Diagram,
    vocabulary: str | Sequence[ModuleKind] = "extended",
    *,
    equilibrium: str = "exact",
) -> tuple[tuple[Violation, ...], tuple[Violation, ...]]:
    """Violations and warnings at the cost of one check."""
    compiled = compile_diagram(diagram, vocabulary, equilibrium=equilibrium)
    return compiled.violations, compiled.warnings


@takes_kinds
def require_legal(
    diagram: Diagram,
    vocabulary: str | Sequence[ModuleKind] = "extended",
    *,
    equilibrium: str = "exact",
) -> None:
    """Raise DiagramError that joins all violations, unless the diagram is legal."""
    found = violations(diagram, vocabulary, equilibrium=equilibrium)
    if found:
        more = f"; and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
        raise DiagramError("; ".join(str(one) for one in found[:SHOWN]) + more)


#: Programs that are remembered, some 30 kB each.
REMEMBERED = 1024


class Examination:
    """The grammar of a run with a memory: proposers ask it about many edits, and it is asked again
    about the chosen one.
    """

    def __init__(self, kinds: Vocabulary, equilibrium: str) -> None:
        self._kinds, self._equilibrium = kinds, equilibrium
        self._known: dict[str, CompiledDiagram] = {}

    @takes_kinds
    def __call__(self, diagram: Diagram, text: str) -> CompiledDiagram:
        """The diagram, whose canonical print is `text`, compiled: it says what there is to say of
        it when it is asked.
        """
        if text not in self._known:
            if len(self._known) >= REMEMBERED:
                self._known.clear()
            self._known[text] = CompiledDiagram(diagram, self._kinds, self._equilibrium)
        return self._known[text]
