"""What a repair changed in the program: the lines, and the block diagrams before and after beside each other."""

from ibrid.gap.result import Gap
from ibrid.report.diagrams_beside import Shown, diagrams_beside, readable
from ibrid.report.markup import difference_html, folded, paragraph, program
from ibrid.structure.diagram import Diagram
from ibrid.structure.difference import difference

#: Unchanged lines that are shown on each side of a change.
AROUND = 2


def program_html(gap: Gap) -> str:
    """The changed lines, and the whole repaired program to unfold."""
    changed = changed_lines(gap.given, gap.program) or paragraph("The program stays as it was given.")
    return changed + folded("The whole program", program(gap.program))


def changed_lines(before: str, after: str) -> str:
    """The lines that differ, "" where none do."""
    return difference_html(difference(before, after, AROUND))


def diagrams_html(gap: Gap) -> str:
    """The given and the repaired diagram, what differs framed; the given one alone where nothing changed."""
    kinds = gap.repaired.vocabulary
    given, after = readable(gap.given), readable(gap.program)
    if given is None or after is None:
        return paragraph("The program cannot be read, so there is no diagram to draw.")
    if gap.given == gap.program:
        shown: list[Shown] = [("The given model", given, ())]
    else:
        shown = [
            ("The given model", given, _only_in(given, after)),
            ("The repaired model", after, _only_in(after, given)),
        ]
    framed = any(marked for _, _, marked in shown)
    return diagrams_beside(shown, kinds, "Framed: blocks that the other model does not have." if framed else "")


def _only_in(one: Diagram, other: Diagram) -> tuple[str, ...]:
    """Names of modules that another diagram lacks, or has of another kind or with other bindings."""
    there = {instance.name: instance for instance in other.instances}
    return tuple(instance.name for instance in one.instances if there.get(instance.name) != instance)
