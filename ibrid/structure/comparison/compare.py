"""Two diagrams matched up to naming: which modules and connections they have in common."""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import unified_diff

from ibrid.border import methods_take_kinds, takes_kinds
from ibrid.foreign_text import controls_shown
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import choose_vocabulary
from ibrid.showing import shown
from ibrid.structure.comparison.drawing import Block
from ibrid.structure.comparison.matching import best_matching
from ibrid.structure.comparison.simplify import Simplified, simplified
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.writing import PlainData

SCHEMA = "ibrid.compare/1"


@dataclass(frozen=True)
class Overlap:
    """How much of two sets is common. `common`, `first`, `second` : numbers of members."""

    common: int
    first: int
    second: int

    @property
    def precision(self) -> float:
        """Share of the first that the second has too; 1 when the first is empty."""
        return self.common / self.first if self.first else 1.0

    @property
    def recall(self) -> float:
        """Share of the second that the first has too; 1 when the second is empty."""
        return self.common / self.second if self.second else 1.0

    @property
    def f1(self) -> float:
        """Harmonic mean of the two."""
        total = self.first + self.second
        return 2 * self.common / total if total else 1.0

    def to_json(self) -> dict[str, float]:
        """precision, recall and f1."""
        return {"precision": self.precision, "recall": self.recall, "f1": self.f1}


@methods_take_kinds
@dataclass(frozen=True)
class Comparison:
    """What a first diagram, the found one, and a second, the true one, have in common after
    canonical rewriting.

    `matched` : (name in the first, name in the second). `only_first`, `only_second` : names without
    a partner. Modules that became one block are joined by "+"; signs, fixed gains, slices and packs
    are part of the connections.
    `connections` : links that join matched modules at the same ports with the same signs, up to
    signs that cancel.
    """

    modules: Overlap
    connections: Overlap
    matched: tuple[tuple[str, str], ...]
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]

    @property
    def same(self) -> bool:
        """True when everything of one is in the other."""
        return self.modules.f1 == 1.0 and self.connections.f1 == 1.0

    def __repr__(self) -> str:
        kind = "the same structure" if self.same else "different structures"
        return (
            f"<Comparison: {kind}, F1 {self.modules.f1:.3g} of modules, {self.connections.f1:.3g} "
            "of connections>"
        )

    def _repr_html_(self) -> str:
        """Shares and names, for notebooks."""
        return shown(self, "pages.notebook", "comparison_html")

    def to_json(self) -> PlainData:
        """The JSON of `ibrid compare --json`."""
        return {
            "schema": SCHEMA,
            "modules": self.modules.to_json(),
            "connections": self.connections.to_json(),
            "matched": [list(pair) for pair in self.matched],
            "only_first": list(self.only_first),
            "only_second": list(self.only_second),
            "same": self.same,
        }


@takes_kinds
def compare(
    first: Diagram, second: Diagram, vocabulary: str | Sequence[ModuleKind] = "extended"
) -> Comparison:
    """Match two legal diagrams up to naming; precision is the share of `first` that is in `second`.

    Exact where the diagrams are the same; else the best matching that a few fixed starts and
    exchanges find. Raises DiagramError for a kind or port that does not exist.
    """
    kinds = choose_vocabulary(vocabulary)
    drawing, other = simplified(first, kinds), simplified(second, kinds)
    matching = best_matching(drawing, other)
    pairs = sorted(
        (_label(drawing.blocks[a], first), _label(other.blocks[b], second))
        for a, b in matching.pairs
    )
    return Comparison(
        modules=Overlap(len(pairs), len(_own(drawing)), len(_own(other))),
        connections=Overlap(matching.links, len(drawing.links), len(other.links)),
        matched=tuple(pairs),
        only_first=_without(drawing, {a for a, _ in matching.pairs}, first),
        only_second=_without(other, {b for _, b in matching.pairs}, second),
    )


@takes_kinds
@controls_shown
def format_comparison(comparison: Comparison) -> str:
    """The comparison as lines for a terminal."""
    lines = ["             precision  recall     F1   common/first/second"]
    for label, one in (("modules", comparison.modules), ("connections", comparison.connections)):
        counts = f"{one.common}/{one.first}/{one.second}"
        lines.append(f"{label:12} {one.precision:9.3f} {one.recall:7.3f} {one.f1:6.3f}   {counts}")
    lines += [f"  {a} = {b}" for a, b in comparison.matched]
    if comparison.only_first:
        lines.append(f"only in the first: {', '.join(comparison.only_first)}")
    if comparison.only_second:
        lines.append(f"only in the second: {', '.join(comparison.only_second)}")
    lines.append("the same structure" if comparison.same else "different structures")
    return "\n".join(lines)


def _own(drawing: Simplified) -> list[int]:
    return [number for number, block in drawing.blocks.items() if not block.outer]


def _label(block: Block, diagram: Diagram) -> str:
    places = {instance.name: place for place, instance in enumerate(diagram.instances)}
    return "+".join(sorted(block.names, key=lambda name: places[name]))


def _without(drawing: Simplified, matched: set[int], diagram: Diagram) -> tuple[str, ...]:
    return tuple(
        sorted(
            _label(drawing.blocks[number], diagram)
            for number in _own(drawing)
            if number not in matched
        )
    )


def difference(before: str, after: str, around: int = 1) -> tuple[str, ...]:
    """Lines taken out ("-") and put in ("+"), with `around` lines before and after (" ") and "..."
    where lines are left out.
    """
    lines = list(unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=around))[2:]
    return tuple("..." if line.startswith("@@") else line for line in lines)


def unified(before: str, after: str, names: tuple[str, str]) -> str:
    """A unified diff, as patch and git read it, under the names of both texts; "" where they are
    the same.
    """
    one, other = (text.splitlines(keepends=True) for text in (before, after))
    first, second = (" ".join(name.split()) for name in names)
    return "".join(unified_diff(one, other, first, second))
