"""What a repair changed in the program: the lines, and the block diagrams before and after beside each other."""

import re
from collections.abc import Sequence
from difflib import unified_diff

from ibrid.errors import IbridError
from ibrid.gap.result import Gap
from ibrid.modules.kind import ModuleKind
from ibrid.report.block_diagram import FAMILIES, block_diagram_svg
from ibrid.report.gap_tables import folded
from ibrid.report.markup import escape, paragraph, scroll
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import parse_program

#: Unchanged lines that are shown on each side of a change.
AROUND = 2
#: A drawing may shrink to this before it gets a line of its own.
WIDEST = "68rem"
#: Wider than the text where the window is, so that diagrams find room beside each other.
_BREAKOUT = "width:max(100%,100vw - 3rem);margin-left:calc((100% - max(100%,100vw - 3rem))/2)"


def difference(before: str, after: str) -> tuple[str, ...]:
    """Lines taken out ("-") and put in ("+"), with lines around (" ") and "..." where lines are left out."""
    lines = list(unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=AROUND))[2:]
    return tuple("..." if line.startswith("@@") else line for line in lines)


def program_html(gap: Gap) -> str:
    """The changed lines, and the whole repaired program to unfold."""
    lines = difference(gap.given, gap.program)
    styles = {"+": "good", "-": "bad"}
    shown = "\n".join(
        f'<span class="{styles[line[0]]}" style="font-weight:400">{escape(line)}</span>'
        if line[:1] in styles
        else escape(line)
        for line in lines
    )
    changed = (
        scroll("Program difference", f"<pre><code>{shown}</code></pre>")
        if lines
        else paragraph("The program stays as it was given.")
    )
    whole = scroll("Program text", f"<pre><code>{escape(gap.program)}</code></pre>")
    return changed + folded("The whole program", whole)


def diagrams_html(gap: Gap) -> str:
    """The given and the repaired diagram, what differs framed; the given one alone where nothing changed."""
    kinds = gap.repaired.vocabulary
    given, after = _parsed(gap.given), _parsed(gap.program)
    if given is None or after is None:
        return paragraph("The program cannot be read, so there is no diagram to draw.")
    if not difference(gap.given, gap.program):
        shown = [("The given model", given, ())]
    else:
        shown = [
            ("The given model", given, _only_in(given, after)),
            ("The repaired model", after, _only_in(after, given)),
        ]
    figures = "".join(_drawn(words, block_diagram_svg(diagram, kinds, marked)) for words, diagram, marked in shown)
    note = "Thick lines carry a dq pair, thin ones a scalar; circles add; dots are branches."
    if any(marked for _, _, marked in shown):
        note += " Framed: blocks that the other model does not have."
    legend = _families([diagram for _, diagram, _ in shown], kinds)
    return paragraph(note, "note") + legend + f'<div class="beside" style="{_BREAKOUT}">{figures}</div>'


def _parsed(text: str) -> Diagram | None:
    try:
        return parse_program(text)
    except IbridError:
        return None


def _only_in(one: Diagram, other: Diagram) -> tuple[str, ...]:
    """Names of modules that another diagram lacks, or has of another kind or with other bindings."""
    there = {instance.name: instance for instance in other.instances}
    return tuple(instance.name for instance in one.instances if there.get(instance.name) != instance)


def _drawn(words: str, svg: str) -> str:
    """A figure as wide as its drawing, or narrower where there is no room."""
    width = re.search(r"max-width:(\d+)px", svg)
    room = f"min({width[1]}px,{WIDEST})" if width else "auto"
    style = f"flex:0 1 {room};max-width:{width[1] + 'px' if width else 'none'};flex-grow:1"
    return f'<figure style="{style}"><figcaption>{escape(words)}</figcaption>{scroll(words, svg)}</figure>'


def _families(diagrams: Sequence[Diagram], kinds: Sequence[ModuleKind]) -> str:
    families = {kind.name: kind.family for kind in kinds}
    used = dict.fromkeys(families.get(one.kind, "unknown") for diagram in diagrams for one in diagram.instances)
    words = "".join(
        f'<li><span class="swatch {escape(name.replace(" ", "-"))}"></span>{escape(FAMILIES.get(name, name))}</li>'
        for name in used
    )
    return f'<ul class="legend">{words}</ul>'
