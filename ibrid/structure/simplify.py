"""A diagram rewritten so that different drawings of one controller become the same blocks and links.

Signs, fixed gains, axis selection, packing and zero sources become the weight of a link. Blocks that do nothing go;
blocks that are drawn twice become one; equal blocks on the two axes become one block on the dq pair; linear blocks in a
row are put in one order; a free gain beside a block with a gain of its own goes into that; a PI whose output, beside being
used itself, is integrated becomes the PLL that it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY, choose_vocabulary
from ibrid.structure.canonical import canonical_order
from ibrid.structure.derived_outputs import derived_outputs
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram
from ibrid.structure.parameters import ParameterTable, parameter_table
from ibrid.structure.wiring import Wiring, split_port, wire

#: Kinds whose free parameters scale their output as a whole.
SCALABLE = ("Gain", "Gain_dq", "JMul", "PI", "PI_dq", "SRF_PLL")
GAINS = ("Gain", "Gain_dq")
PLL, INTEGRATOR = "SRF_PLL", "Integrator"


@dataclass(frozen=True)
class Block:
    """A block of the rewritten diagram.

    `names` : the modules that it stands for. `inputs`, `outputs` : port -> width. `parameters` : (name, shared name or
    number). `axes` : True when it applies one scalar law to both axes. `siso` : True for one input and one output port
    that a linear time-invariant law joins, whatever the operating point.
    """

    kind: str
    names: tuple[str, ...]
    inputs: dict[str, int]
    outputs: dict[str, int]
    parameters: tuple[tuple[str, str | float], ...] = ()
    axes: bool = False
    siso: bool = False
    outer: bool = False

    @property
    def width(self) -> int:
        """Width of the only input port of a `siso` block."""
        return next(iter(self.inputs.values()))


Key = tuple[int, str, int, str]  # source block and port, target block and port


@dataclass(frozen=True)
class Simplified:
    """Blocks by number and weighted links between their ports; a weight has the shape (target width, source width)."""

    blocks: dict[int, Block]
    links: dict[Key, np.ndarray]


def simplified(diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = VOCABULARY) -> Simplified:
    """Rewrite a legal diagram; the result does not depend on names or on the order of lines."""
    rewriter = _Rewriter(diagram, choose_vocabulary(vocabulary))
    rewriter.run()
    return Simplified(dict(rewriter.blocks), dict(rewriter.links))


class _Rewriter:
    def __init__(self, diagram: Diagram, vocabulary: Sequence[ModuleKind]) -> None:
        self.scalar_of = {
            kind.name: kind.name.removesuffix("_dq")
            for kind in vocabulary
            if kind.name.endswith("_dq") and any(other.name == kind.name.removesuffix("_dq") for other in vocabulary)
        }
        self.knows_plls = any(kind.name == PLL for kind in vocabulary)
        self.blocks: dict[int, Block] = {}
        self.links: dict[Key, np.ndarray] = {}
        wiring = wire(diagram, vocabulary)
        table = parameter_table(wiring, "exact")
        self._load(wiring, table, canonical_order(diagram, vocabulary))

    def run(self) -> None:
        steps = (
            self._remove_idle,
            self._join_duplicates,
            self._join_plls,
            self._split_axes,
            self._join_axes,
            self._drop_gains,
            self._sort_chains,
        )
        for _ in range(4 * len(self.blocks) + 4):
            changes = [step() for step in steps]
            if not any(changes):
                return

    # --- reading the diagram ------------------------------------------------------------------------------------

    def _load(self, wiring: Wiring, table: ParameterTable, order: tuple[str, ...]) -> None:
        self.blocks[0] = Block(TERMINAL_VOLTAGE, (), {}, {TERMINAL_VOLTAGE: 2}, outer=True)
        self.blocks[1] = Block(TERMINAL_CURRENT, (), {TERMINAL_CURRENT: 2}, {}, outer=True)
        place = {TERMINAL_VOLTAGE: 0, TERMINAL_CURRENT: 1}
        for number, name in enumerate(order, start=2):
            place[name] = number
            self.blocks[number] = self._block(name, wiring.kinds[name], table)
        for target, sources in wiring.sources.items():
            name, port = split_port(target)
            for source in sources:
                other, output = split_port(source)
                width = self.blocks[place[other or output]].outputs[output]
                self._add(place[other or output], output, place[name or port], port, np.eye(width))
        for name in order:
            self._replace_derived(place[name], wiring.kinds[name])
        for name in order:
            through = _wire_matrix(wiring.kinds[name], dict(self.blocks[place[name]].parameters))
            if through is not None:
                self._eliminate(place[name], through)

    def _block(self, name: str, kind: ModuleKind, table: ParameterTable) -> Block:
        ports_in = {port: signal.width for port, signal in kind.inputs.items()}
        ports_out = {port: signal.width for port, signal in kind.outputs.items()}
        single = len(ports_in) == len(ports_out) == 1 and not kind.equilibrium_ports and not kind.uses_frame
        axes = kind.name in self.scalar_of or (kind.delay is not None and list(ports_in.values()) == [2])
        same = list(ports_in.values()) == list(ports_out.values())
        siso = single and same and (axes or kind.name == "JMul" or list(ports_in.values()) == [1])
        parameters = tuple((one, table.of(name, one)) for one in kind.parameters)
        return Block(kind.name, (name,), ports_in, ports_out, parameters, axes, siso)

    def _replace_derived(self, number: int, kind: ModuleKind) -> None:
        """Read outputs that are fixed combinations of others, such as i_C = i_ti - i_g, from those."""
        for output, origins in derived_outputs(kind).items():
            users = [(key, weight) for key, weight in self.links.items() if key[:2] == (number, output)]
            for key, weight in users:
                del self.links[key]
                for (side, port), matrix in origins.items():
                    if side == "output":
                        self._add(number, port, key[2], key[3], weight @ matrix)
                        continue
                    for source, inner in [one for one in self.links.items() if one[0][2:] == (number, port)]:
                        self._add(source[0], source[1], key[2], key[3], weight @ matrix @ inner)

    # --- links --------------------------------------------------------------------------------------------------

    def _add(self, source: int, output: str, target: int, port: str, weight: np.ndarray) -> None:
        key = (source, output, target, port)
        total = self.links.pop(key, 0.0) + weight
        total = np.where(np.abs(total) < 1e-12, 0.0, total)
        if total.any():
            self.links[key] = total

    def _into(self, number: int) -> list[tuple[Key, np.ndarray]]:
        return [(key, weight) for key, weight in self.links.items() if key[2] == number]

    def _out_of(self, number: int) -> list[tuple[Key, np.ndarray]]:
        return [(key, weight) for key, weight in self.links.items() if key[0] == number]

    def _remove(self, number: int) -> None:
        del self.blocks[number]
        self.links = {key: weight for key, weight in self.links.items() if number not in (key[0], key[2])}

    def _eliminate(self, number: int, through: dict[tuple[str, str], np.ndarray]) -> bool:
        """Replace a block y = D u by links; False when it closes a loop on itself that has no solution."""
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
        inner = [(key, weight) for key, weight in self._into(number) if key[0] != number]
        outer = [(key, weight) for key, weight in self._out_of(number) if key[2] != number]
        self._remove(number)
        for (source, output, _, port), entering in inner:
            solved = closed[:, offsets[port] : offsets[port] + block.inputs[port]] @ entering
            for (_, leaving, target, entry), weight in outer:
                direct = np.hstack([through[leaving, one] for one in block.inputs])
                self._add(source, output, target, entry, weight @ direct @ solved)
        return True

    # --- steps; each returns whether it changed anything ----------------------------------------------------------

    def _remove_idle(self) -> bool:
        """Blocks that the terminal voltage does not reach, or that do not reach the terminal current."""
        after, before = self._reach(0, 0, 2), self._reach(1, 2, 0)
        idle = [number for number, block in self.blocks.items() if not block.outer and number not in after & before]
        for number in idle:
            self._remove(number)
        return bool(idle)

    def _reach(self, start: int, here: int, there: int) -> set[int]:
        """Blocks reached along the links; `here`, `there` : places of the blocks in a link's key, 0 or 2."""
        reached, front = {start}, [start]
        for number in front:
            for key in self.links:
                if key[here] == number and key[there] not in reached:
                    reached.add(int(key[there]))
                    front.append(int(key[there]))
        return reached

    def _join_duplicates(self) -> bool:
        """Two blocks of one law with the same inputs are one block."""
        seen: dict[tuple, int] = {}
        for number, block in list(self.blocks.items()):
            entering = tuple(sorted((key[0], key[1], key[3], weight.tobytes()) for key, weight in self._into(number)))
            law = (block.kind, block.parameters, entering)
            if block.outer:
                continue
            if law in seen:
                kept = seen[law]
                for key, weight in self._out_of(number):
                    self._add(kept, key[1], key[2], key[3], weight)
                self.blocks[kept] = replace(self.blocks[kept], names=self.blocks[kept].names + block.names)
                self._remove(number)
                return True
            seen[law] = number
        return False

    def _join_plls(self) -> bool:
        """A frequency from a PI, and the angle as its integral, are the two outputs of a phase-locked loop."""
        if not self.knows_plls:
            return False
        for angle, block in self.blocks.items():
            entering = self._into(angle)
            if block.kind != INTEGRATOR or len(entering) != 1:
                continue
            ((regulator, output, _, _), weight) = entering[0]
            leaving = self._out_of(regulator)
            if self.blocks[regulator].kind == "PI" and len(leaving) > 1 and np.array_equal(weight, [[1.0]]):
                self._join_pll(regulator, output, angle)
                return True
        return False

    def _join_pll(self, regulator: int, frequency: str, angle: int) -> None:
        first, second = self.blocks[regulator], self.blocks[angle]
        (port,), (integral,) = first.inputs, second.outputs
        into = self._into(regulator)
        out = [(key, "delta_omega", weight) for key, weight in self._out_of(regulator) if key[2] != angle]
        out += [(key, "delta", weight) for key, weight in self._out_of(angle)]
        self._remove(angle)
        self._remove(regulator)
        self.blocks[regulator] = Block(
            PLL,
            first.names + second.names,
            {"e_q": 1},
            {"delta_omega": 1, "delta": 1},
            tuple((f"{name}_pll", value) for name, value in first.parameters),
        )
        own = {(regulator, frequency): "delta_omega", (angle, integral): "delta"}
        for key, weight in into:
            source = own.get(key[:2])
            self._add(regulator if source else key[0], source or key[1], regulator, "e_q", weight)
        for key, output, weight in out:
            if key[2:] != (regulator, port):  # a loop onto itself is among those that enter
                self._add(regulator, output, key[2], key[3], weight)

    def _split_axes(self) -> bool:
        """A block on both axes of which one axis is idle, or whose neighbours are all scalar, is scalar itself."""
        for number, block in list(self.blocks.items()):
            scalar = self.scalar_of.get(block.kind, block.kind.removesuffix("_dq"))
            if not block.axes or scalar == block.kind:
                continue
            (port,), (output,) = block.inputs, block.outputs
            into, out = self._into(number), self._out_of(number)
            live = [
                axis
                for axis in (0, 1)
                if any(weight[axis].any() for _, weight in into) and any(weight[:, axis].any() for _, weight in out)
            ]
            scalar_around = all(weight.shape[1] == 1 for _, weight in into) and all(
                weight.shape[0] == 1 for _, weight in out
            )
            looped = any(key[0] == number for key, _ in into)
            if looped or (len(live) == 2 and not scalar_around):
                continue
            self._remove(number)
            for axis in live:
                fresh = number if axis == live[0] else max(self.blocks) + 1
                self.blocks[fresh] = replace(block, kind=scalar, inputs={port: 1}, outputs={output: 1}, axes=False)
                for key, weight in into:
                    self._add(key[0], key[1], fresh, port, weight[[axis]])
                for key, weight in out:
                    self._add(fresh, output, key[2], key[3], weight[:, [axis]])
            return True
        return False

    def _join_axes(self) -> bool:
        """Equal scalar blocks on the d and the q channel of the same signals are one block on the pair."""
        scalars: dict[tuple, list[int]] = {}
        for number, block in self.blocks.items():
            if block.siso and block.width == 1:
                scalars.setdefault((block.kind, block.parameters), []).append(number)
        for alike in scalars.values():
            ends = {one: self._ends(one) for one in alike} if len(alike) > 1 else {}
            for d, q in permutations(ends, 2):
                if _opposite_axes(ends[d][1], ends[q][1]) or _opposite_axes(ends[d][0], ends[q][0]):
                    self._pack(d, q)
                    return True
        return False

    def _ends(self, number: int) -> tuple[list, list]:
        """The far ports of a scalar block, each with the weight as a column on that port: upstream, downstream."""
        entering = [(key[:2], weight.T) for key, weight in self._into(number)]
        return entering, [(key[2:], weight) for key, weight in self._out_of(number)]

    def _pack(self, d: int, q: int) -> None:
        first, second = self.blocks[d], self.blocks[q]
        (port,), (output,) = first.inputs, first.outputs
        into = [(key, weight, axis) for axis, one in enumerate((d, q)) for key, weight in self._into(one)]
        out = [(key, weight, axis) for axis, one in enumerate((d, q)) for key, weight in self._out_of(one)]
        names = tuple(dict.fromkeys(first.names + second.names))
        self._remove(d)
        self._remove(q)
        self.blocks[d] = replace(
            first, kind=f"{first.kind}_dq", names=names, inputs={port: 2}, outputs={output: 2}, axes=True
        )
        unit = np.eye(2)
        for key, weight, axis in into:
            if key[0] not in (d, q):
                self._add(key[0], key[1], d, port, unit[:, [axis]] @ weight)
        for key, weight, axis in out:
            spread = weight @ unit[[axis]]
            if key[2] in (d, q):
                spread = unit[:, [(d, q).index(key[2])]] @ spread
                self._add(d, output, d, port, spread)
            else:
                self._add(d, output, key[2], key[3], spread)

    def _chained(self) -> list[Key]:
        """Links that are the only one out of their source and the only one into their target, both linear blocks."""
        out, into = {}, {}
        for key in self.links:
            out.setdefault(key[0], []).append(key)
            into.setdefault(key[2], []).append(key)
        return [
            key
            for key in self.links
            if key[0] != key[2]
            and len(out[key[0]]) == len(into[key[2]]) == 1
            and self.blocks[key[0]].siso
            and (self.blocks[key[2]].siso or self.blocks[key[2]].kind == PLL)
        ]

    def _scales(self, number: int) -> bool:
        """True when the block's gain is free and its parameters belong to it alone."""
        block = self.blocks[number]
        words = {value for _, value in block.parameters}
        others = {value for other, one in self.blocks.items() if other != number for _, value in one.parameters}
        return block.kind in SCALABLE and all(isinstance(word, str) for word in words) and not words & others

    def _drop_gains(self) -> bool:
        for key in self._chained():
            for gain, other in ((key[0], key[2]), (key[2], key[0])):
                if self.blocks[gain].kind in GAINS and self._scales(gain) and self._scales(other):
                    block = self.blocks[gain]
                    (port,), (output,) = block.inputs, block.outputs
                    self.blocks[other] = replace(self.blocks[other], names=self.blocks[other].names + block.names)
                    return self._eliminate(gain, {(output, port): np.eye(block.width)})
        return False

    def _sort_chains(self) -> bool:
        for key in self._chained():
            first, second = self.blocks[key[0]], self.blocks[key[2]]
            weight = self.links[key]
            if not second.siso or _rank(first) <= _rank(second) or first.width != second.width:
                continue
            if "JMul" in (first.kind, second.kind) and not np.array_equal(weight, weight[0, 0] * np.eye(2)):
                continue
            self._exchange(key[0], key[2])
            return True
        return False

    def _exchange(self, one: int, other: int) -> None:
        """Let two blocks of one input and one output change places."""
        first, second = self.blocks[one], self.blocks[other]
        self.blocks[one], self.blocks[other] = second, first
        ports = {one: second, other: first}
        renamed = {}
        for (source, output, target, port), weight in self.links.items():
            output = next(iter(ports[source].outputs)) if source in ports else output
            port = next(iter(ports[target].inputs)) if target in ports else port
            renamed[source, output, target, port] = weight
        self.links = renamed


def _rank(block: Block) -> tuple[bool, str]:
    return block.kind not in SCALABLE, block.kind


def _opposite_axes(first: list, second: list) -> bool:
    """True when the first touches the d channel of those dq ports of which the second touches the q channel."""
    if not first or {port for port, _ in first} != {port for port, _ in second}:
        return False
    on_d = all(weight.shape[0] == 2 and not weight[1].any() for _, weight in first)
    return on_d and all(weight.shape[0] == 2 and not weight[0].any() for _, weight in second)


def _wire_matrix(kind: ModuleKind, parameters: dict[str, str | float]) -> dict[tuple[str, str], np.ndarray] | None:
    """(output, input) -> matrix of a memoryless kind without free parameters or context: a piece of wire."""
    fixed = {name: value for name, value in parameters.items() if isinstance(value, float)}
    if not kind.static or len(fixed) < len(parameters) or kind.context(1.0, (1.0, 0.0), {}):
        return None
    rows = np.array(kind.state_space(**fixed)[3], dtype=float).reshape(
        sum(signal.width for signal in kind.outputs.values()), -1
    )
    found, top = {}, 0
    for output, signal in kind.outputs.items():
        left = 0
        for port, entering in kind.inputs.items():
            found[output, port] = rows[top : top + signal.width, left : left + entering.width]
            left += entering.width
        top += signal.width
    return found
