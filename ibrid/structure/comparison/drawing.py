"""A drawing of a controller: blocks, links with weights between their ports, and what may be done
to them.

The law stays as it is whatever is done: a block y = D u becomes links, blocks in a row change
places.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.modules.behaviour import Element, same_on_one_axis
from ibrid.modules.kind import ModuleKind

Key = tuple[int, str, int, str]  # source block and port, target block and port


@dataclass(frozen=True)
class Block:
    """A block of a drawing.

    `kind` : name of its kind, or of the scalar or dq form of that. `names` : the modules that it
    stands for. `inputs`, `outputs` : port -> width. `parameters` : (name, shared name or number).
    `element` : what it is. `axes` : True when it applies one scalar law to both axes. `siso` : True
    for one input and one output port that a linear time-invariant law joins, whatever the operating
    point. `scales` : True when some of its parameters scale its output as a whole.
    """

    kind: str
    names: tuple[str, ...]
    inputs: dict[str, int]
    outputs: dict[str, int]
    parameters: tuple[tuple[str, str | float], ...] = ()
    element: Element | None = None
    axes: bool = False
    siso: bool = False
    scales: bool = False
    outer: bool = False

    @property
    def width(self) -> int:
        """Width of the only input port of a `siso` block."""
        return next(iter(self.inputs.values()))


class Drawing:
    """Blocks by number and links between their ports, being rewritten; a weight has the shape
    (target width, source width).

    `scalar_of` : kind on both axes -> kind of the same law on one axis; `dq_of` the other way
    round.
    `pll` : the kind that a PI regulator with an integrator behind it is; None in a vocabulary
    without one.
    """

    def __init__(self, vocabulary: Sequence[ModuleKind]) -> None:
        self.blocks: dict[int, Block] = {}
        self.links: dict[Key, np.ndarray] = {}
        self.scalar_of = _scalar_forms(vocabulary)
        self.dq_of = {scalar: vector for vector, scalar in reversed(self.scalar_of.items())}
        self.pll = next(
            (
                kind
                for kind in vocabulary
                if kind.element is Element.PLL and kind.input_at_rest is None
            ),
            None,
        )

    def add(self, source: int, output: str, target: int, port: str, weight: np.ndarray) -> None:
        """Add a weight to a link; one of zero goes."""
        key = (source, output, target, port)
        total = self.links.pop(key, 0.0) + weight
        total = np.where(np.abs(total) < 1e-12, 0.0, total)
        if total.any():
            self.links[key] = total

    def into(self, number: int) -> list[tuple[Key, np.ndarray]]:
        """Links that enter a block."""
        return [(key, weight) for key, weight in self.links.items() if key[2] == number]

    def out_of(self, number: int) -> list[tuple[Key, np.ndarray]]:
        """Links that leave a block."""
        return [(key, weight) for key, weight in self.links.items() if key[0] == number]

    def remove(self, number: int) -> None:
        """Take a block and its links away."""
        del self.blocks[number]
        self.links = {
            key: weight for key, weight in self.links.items() if number not in (key[0], key[2])
        }

    def eliminate(self, number: int, through: dict[tuple[str, str], np.ndarray]) -> bool:
        """Replace a block y = D u by links; False when it closes a loop on itself that has no
        solution.
        """
        block = self.blocks[number]
        offsets = dict(zip(block.inputs, np.cumsum([0, *block.inputs.values()]), strict=False))
        height = sum(block.inputs.values())
        loop = np.eye(height)
        for (source, output, target, port), weight in self.links.items():
            if source == target == number:
                rows = slice(offsets[port], offsets[port] + block.inputs[port])
                for entry, width in block.inputs.items():
                    columns = slice(offsets[entry], offsets[entry] + width)
                    loop[rows, columns] -= weight @ through[output, entry]
        if height and abs(np.linalg.det(loop)) < 1e-9:
            return False
        closed = np.linalg.inv(loop) if height else loop
        inner = [(key, weight) for key, weight in self.into(number) if key[0] != number]
        outer = [(key, weight) for key, weight in self.out_of(number) if key[2] != number]
        self.remove(number)
        for (source, output, _, port), entering in inner:
            solved = closed[:, offsets[port] : offsets[port] + block.inputs[port]] @ entering
            for (_, leaving, target, entry), weight in outer:
                direct = np.hstack([through[leaving, one] for one in block.inputs])
                self.add(source, output, target, entry, weight @ direct @ solved)
        return True

    def exchange(self, block: int, other: int) -> None:
        """Let two blocks of one input and one output change places."""
        first, second = self.blocks[block], self.blocks[other]
        self.blocks[block], self.blocks[other] = second, first
        ports = {block: second, other: first}
        renamed = {}
        for (source, output, target, port), weight in self.links.items():
            output = next(iter(ports[source].outputs)) if source in ports else output
            port = next(iter(ports[target].inputs)) if target in ports else port
            renamed[source, output, target, port] = weight
        self.links = renamed


def _scalar_forms(vocabulary: Sequence[ModuleKind]) -> dict[str, str]:
    """Kinds on both axes -> the kind of the same law on one; of several the one whose name lacks
    the ending _dq.
    """
    forms = {}
    for vector in vocabulary:
        if vector.per_axis:
            alike = [scalar.name for scalar in vocabulary if same_on_one_axis(scalar, vector)]
            if alike:
                own = vector.name.removesuffix("_dq")
                forms[vector.name] = own if own in alike else alike[0]
    return forms
