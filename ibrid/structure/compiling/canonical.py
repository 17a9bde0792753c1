"""The hash of a structure: equal for diagrams that differ in names and order of lines alone, and
for no others.
"""

from collections.abc import Sequence

from ibrid.border import takes_kinds
from ibrid.modules.kind import ModuleKind
from ibrid.structure.compiling.compiled import compile_diagram
from ibrid.structure.diagrams.diagram import Diagram


@takes_kinds
def structure_hash(
    diagram: Diagram,
    vocabulary: str | Sequence[ModuleKind] = "extended",
    *,
    equilibrium: str = "exact",
) -> str:
    """Hash of kinds, connections, sharing of parameters, fixed values and boxes of a legal diagram;
    32 hex digits.

    Names of modules and of parameters, the order of the lines and the name of the function do not
    enter. Raises DiagramError for a kind or port that does not exist.
    """
    return compile_diagram(diagram, vocabulary, equilibrium=equilibrium).structure_hash


@takes_kinds
def canonical_order(
    diagram: Diagram,
    vocabulary: str | Sequence[ModuleKind] = "extended",
    *,
    equilibrium: str = "exact",
) -> tuple[str, ...]:
    """Names of the modules in an order that depends on the structure alone; diagrams of one hash
    correspond in it.
    """
    return compile_diagram(diagram, vocabulary, equilibrium=equilibrium).canonical_order
