"""What drives each input while an edit is being read, and what may be cut or wired next."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ibrid.modules.kind import ModuleKind
from ibrid.signals import Signal
from ibrid_policy.edit import Rewiring, after_structure, input_order
from ibrid_policy.numbering import IN, OUT, OUTER, Numbered, Port
from ibrid_policy.tokens import CUT, WIRE


@dataclass
class RewiredInput:
    """An input that is being rewired."""

    target: Port
    cut: list[Port]
    wired: list[Port]

    @property
    def rewiring(self) -> Rewiring:
        """What it came to."""
        return Rewiring(self.target, tuple(sorted(self.cut)), tuple(sorted(self.wired)))


class Wires:
    """The wires of a diagram whose modules are settled; inputs are visited in their order, and none
    twice.

    `sources` : input -> what drives it now. `blocks` : the inputs that were rewired.
    """

    def __init__(
        self,
        parent: Numbered,
        swapped: Mapping[int, ModuleKind],
        removed: set[int],
        kinds: Sequence[ModuleKind],
    ) -> None:
        self.kinds, self.removed = kinds, removed
        self.sources = after_structure(parent, swapped, removed)
        for number in range(len(parent.kinds), len(kinds)):
            self.sources |= {(number, port): [] for port in kinds[number].inputs}
        self.inputs: list[Port] = []
        for number in input_order(parent, len(kinds)):
            if number == OUTER:
                self.inputs.append(OUT)
            elif number not in removed:
                self.inputs += [(number, port) for port in kinds[number].inputs]
        self.at = -1
        self.blocks: list[RewiredInput] = []

    @property
    def bare(self) -> bool:
        """True while an input is undriven."""
        return any(not self.sources[port] for port in self.inputs)

    def targets(self) -> Iterator[Port]:
        """Inputs that may be rewired next: none may be left behind undriven."""
        for port in self.inputs[self.at + 1 :]:
            if self.sources[port] or any(True for _ in self.candidates(WIRE, port)):
                yield port
            if not self.sources[port]:
                return

    def block(self, target: Port) -> RewiredInput | None:
        """What has been done to this input."""
        return self.blocks[-1] if self.blocks and self.blocks[-1].target == target else None

    def candidates(self, mark: str, target: Port) -> Iterator[Port]:
        """Outputs that may be cut from an input, or wired to it: in the order of their numbers."""
        block = self.block(target) or RewiredInput(target, [], [])
        have, done = self.sources[target], block.cut if mark == CUT else block.wired
        last = max(done, default=(OUTER - 1, ""))
        if mark == CUT:
            only = len(have) == 1 and not any(one != have[0] for one in self._carrying(target))
            yield from (one for one in sorted(have) if one > last and not only)
            return
        for one in self._carrying(target):
            if one > last and one not in have and one not in block.cut:
                yield one

    def begin(self, target: Port) -> None:
        """Visit an input: those before it stay as they are."""
        self.at = self.inputs.index(target)

    def change(self, mark: str, target: Port, source: Port) -> None:
        """Cut or wire an output."""
        if self.block(target) is None:
            self.blocks.append(RewiredInput(target, [], []))
        block = self.blocks[-1]
        if mark == CUT:
            block.cut.append(source)
            self.sources[target].remove(source)
        else:
            block.wired.append(source)
            self.sources[target].append(source)

    def _carrying(self, target: Port) -> Iterator[Port]:
        """Outputs of the signal of an input, in the order of their numbers; the terminals are never
        joined directly.
        """
        signal = Signal.DQ_VEC if target == OUT else self.kinds[target[0]].inputs[target[1]]
        if signal is Signal.DQ_VEC and target != OUT:
            yield IN
        for number, kind in enumerate(self.kinds):
            if number not in self.removed:
                for port in sorted(
                    name for name, carried in kind.outputs.items() if carried is signal
                ):
                    yield number, port
