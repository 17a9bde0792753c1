"""A diagram compiled: read once against a vocabulary, and what follows from that derived once and
passed on.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

from ibrid.border import takes_kinds
from ibrid.errors import DiagramError, near
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary, choose_vocabulary
from ibrid.structure.compiling.canonical_form import CanonicalForm, canonical_form, structure_graph
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.grammar_rules.algebraic_loops import AlgebraicLoop, DirectTerms
from ibrid.structure.grammar_rules.grammar import (
    check_effort,
    check_equilibria,
    check_loops,
    check_program,
)
from ibrid.structure.grammar_rules.habits import check_habits
from ibrid.structure.grammar_rules.violation import Violation, Violations
from ibrid.structure.network.outside import Outside
from ibrid.structure.reading.parameters import EQUILIBRIA, ParameterTable, parameter_table
from ibrid.structure.reading.wiring import Wiring, split_port, wire


@dataclass(frozen=True, eq=False)
class CompiledDiagram:
    """Hold a diagram with the vocabulary and the physics that it is read with; derive what follows
    from them once each.

    Nothing is derived before it is asked for. `violations` and `warnings` answer for every diagram;
    whatever stands on `wiring` raises DiagramError for a kind or port that does not exist, which
    `violations` names.

    Parameters
    ----------
    diagram : Diagram
        Copied, so that what is added to the given one later changes nothing here.
    vocabulary : tuple[ModuleKind, ...]
        The kinds that the diagram may be made of.
    equilibrium : str
        "exact" (operating points are computed) or "paper" (they are free parameters); DiagramError
        for another word.
    """

    diagram: Diagram
    vocabulary: Vocabulary
    equilibrium: str = "exact"

    def __post_init__(self) -> None:
        if self.equilibrium not in EQUILIBRIA:
            raise DiagramError(
                f"no equilibrium mode is called {self.equilibrium!r:.40}; "
                f"{near(self.equilibrium, EQUILIBRIA)}"
            )
        object.__setattr__(self, "diagram", self.diagram.copy())

    def behind(self, outside: Outside) -> "CompiledDiagram":
        """Compile the same diagram behind other labels and another port; this one where they are
        the same.
        """
        if outside == self.diagram.outside:
            return self
        return CompiledDiagram(self.diagram.behind(outside), self.vocabulary, self.equilibrium)

    @cached_property
    def wiring(self) -> Wiring:
        """Its kinds and the sources of every input, in the order of the program."""
        return wire(self.diagram, self.vocabulary)

    @cached_property
    def parameter_table(self) -> ParameterTable:
        """Its parameters, in the order of the program."""
        return parameter_table(self.wiring, self.equilibrium)

    @cached_property
    def violations(self) -> tuple[Violation, ...]:
        """Every breach of the grammar, by line; empty for a legal diagram.

        Whether loops can be solved and operating points be found is asked once all else is right.
        """
        findings = Violations()
        instances, connections = self.diagram.instances, self.diagram.connections
        check_program(instances, connections, self.vocabulary, self.equilibrium, findings)
        if not findings:
            terms = self._direct_terms
            check_effort(len(self.parameter_table.free), terms.largest_loop, findings)
            if not findings:
                check_loops(connections, terms.loops, findings)
                if self.equilibrium == "exact":
                    check_equilibria(self.wiring.devices, findings)
        return findings.sorted

    @cached_property
    def warnings(self) -> tuple[Violation, ...]:
        """What is legal but probably a mistake, by line; empty for a diagram that is not legal."""
        findings = Violations()
        if not self.violations:
            check_habits(self.wiring, self.vocabulary, self.equilibrium, findings)
        return findings.sorted

    @cached_property
    def algebraic_loops(self) -> tuple[AlgebraicLoop, ...]:
        """Its loops of direct terms; the time that they take is bounded for a diagram within
        `grammar.check_effort`.
        """
        return self._direct_terms.loops

    @cached_property
    def canonical_order(self) -> tuple[str, ...]:
        """Names of the modules in an order that depends on the structure alone; diagrams of one
        hash correspond in it.
        """
        names = [instance.name for instance in self.diagram.instances]
        return tuple(
            names[vertex - 2]
            for vertex in self._canonical_form.order
            if 2 <= vertex < len(names) + 2
        )

    @cached_property
    def structure_hash(self) -> str:
        """Hash of kinds, connections, sharing of parameters, fixed values and boxes; 32 hex
        digits.
        """
        return hashlib.sha256(self._canonical_form.text.encode()).hexdigest()[:32]

    @cached_property
    def hash(self) -> str:
        """`structure_hash`; "" where a kind or port does not exist, which `violations` names."""
        try:
            return self.structure_hash
        except DiagramError:
            return ""

    @cached_property
    def canonical_wiring(self) -> Wiring:
        """The wiring in an order that depends on the structure alone, so that renaming or
        reordering changes no number.
        """
        wiring = self.wiring
        rank = {name: index for index, name in enumerate(self.canonical_order)}
        instances = tuple(sorted(wiring.instances, key=lambda instance: rank[instance.name]))

        def place(port: str) -> tuple[int, str]:
            name, inner = split_port(port)
            return rank.get(name, -1), inner

        return Wiring(
            instances,
            {instance.name: wiring.kinds[instance.name] for instance in instances},
            {
                target: tuple(sorted(wiring.sources[target], key=place))
                for target in sorted(wiring.sources, key=place)
            },
            wiring.outside,
        )

    @cached_property
    def _canonical_form(self) -> CanonicalForm:
        return canonical_form(*structure_graph(self.wiring, self.parameter_table, self.equilibrium))

    @cached_property
    def _direct_terms(self) -> DirectTerms:
        """Direct terms; of the parameters under the exact equilibrium those of the paper are
        none.
        """
        table = (
            self.parameter_table
            if self.equilibrium == "exact"
            else parameter_table(self.wiring, "exact")
        )
        return DirectTerms(self.wiring, table, self.equilibrium)

    def __getstate__(self) -> dict[str, Any]:
        """What was given travels to workers, not what was derived from it."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@takes_kinds
def compile_diagram(
    diagram: Diagram,
    vocabulary: str | Sequence[ModuleKind] = "extended",
    *,
    equilibrium: str = "exact",
) -> CompiledDiagram:
    """Compile a diagram, legal or not, whose properties then answer for it.

    Parameters
    ----------
    diagram : Diagram
        What is to be read.
    vocabulary : str or sequence of ModuleKind
        "paper", "extended" or kinds of one's own (`choose_vocabulary`).
    equilibrium : str
        "exact" (operating points are computed) or "paper" (they are free parameters).

    Raises
    ------
    DiagramError
        An unknown vocabulary or equilibrium mode, or two kinds of one name.
    """
    return CompiledDiagram(diagram, choose_vocabulary(vocabulary), equilibrium)
