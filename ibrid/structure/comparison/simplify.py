"""A diagram rewritten so that different drawings of one controller become the same blocks and
links.

Signs, fixed gains, axis selection, packing and zero sources become the weight of a link. Blocks
that do nothing go; blocks that are drawn twice become one; equal blocks on the two axes become one
block on the dq pair; linear blocks in a row are put in one order; a free gain beside a block with a
gain of its own goes into that; a PI whose output, beside being used itself, is integrated becomes
the PLL that it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import networkx as nx
import numpy as np

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import choose_vocabulary
from ibrid.structure.comparison.drawing import Block, Drawing, Key
from ibrid.structure.comparison.linear_blocks import (
    drop_gains,
    join_axes,
    join_plls,
    sort_rows,
    split_axes,
)
from ibrid.structure.compiling.canonical import canonical_order
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE, Diagram
from ibrid.structure.reading.derived_outputs import by_port, derived_outputs
from ibrid.structure.reading.parameters import ParameterTable, parameter_table
from ibrid.structure.reading.wiring import Wiring, split_port, wire


@dataclass(frozen=True)
class Simplified:
    """Blocks by number and weighted links between their ports; a weight has the shape (target
    width, source width).
    """

    blocks: dict[int, Block]
    links: dict[Key, np.ndarray]


def simplified(diagram: Diagram, vocabulary: str | Sequence[ModuleKind] = "extended") -> Simplified:
    """Rewrite a legal diagram; the result does not depend on names or on the order of lines."""
    kinds = choose_vocabulary(vocabulary)
    drawing, wiring = Drawing(kinds), wire(diagram, kinds)
    _load(drawing, wiring, parameter_table(wiring, "exact"), canonical_order(diagram, kinds))
    steps = (
        _remove_idle,
        _join_duplicates,
        join_plls,
        split_axes,
        join_axes,
        drop_gains,
        sort_rows,
    )
    for _ in range(4 * len(drawing.blocks) + 4):
        changes = [step(drawing) for step in steps]
        if not any(changes):
            break
    return Simplified(dict(drawing.blocks), dict(drawing.links))


# --- reading the diagram
# ----------------------------------------------------------------------------------------------


def _load(drawing: Drawing, wiring: Wiring, table: ParameterTable, order: tuple[str, ...]) -> None:
    drawing.blocks[0] = Block(TERMINAL_VOLTAGE, (), {}, {TERMINAL_VOLTAGE: 2}, outer=True)
    drawing.blocks[1] = Block(TERMINAL_CURRENT, (), {TERMINAL_CURRENT: 2}, {}, outer=True)
    place = {TERMINAL_VOLTAGE: 0, TERMINAL_CURRENT: 1}
    for number, name in enumerate(order, start=2):
        place[name] = number
        drawing.blocks[number] = _block(name, wiring.kinds[name], table)
    for target, sources in wiring.sources.items():
        name, port = split_port(target)
        for source in sources:
            other, output = split_port(source)
            width = drawing.blocks[place[other or output]].outputs[output]
            drawing.add(place[other or output], output, place[name or port], port, np.eye(width))
    for name in order:
        _replace_derived(drawing, place[name], wiring.kinds[name])
    for name in order:
        through = _wire_matrix(wiring.kinds[name], dict(drawing.blocks[place[name]].parameters))
        if through is not None:
            drawing.eliminate(place[name], through)


def _block(name: str, kind: ModuleKind, table: ParameterTable) -> Block:
    ports_in = {port: signal.width for port, signal in kind.inputs.items()}
    ports_out = {port: signal.width for port, signal in kind.outputs.items()}
    single = (
        len(ports_in) == len(ports_out) == 1 and not kind.equilibrium_ports and not kind.uses_frame
    )
    axes = kind.per_axis and not kind.shares
    same = list(ports_in.values()) == list(ports_out.values())
    siso = (
        single
        and same
        and (axes or kind.element is Element.COUPLING or list(ports_in.values()) == [1])
    )
    parameters = tuple((one, table.of(name, one)) for one in kind.parameters)
    return Block(
        kind.name, (name,), ports_in, ports_out, parameters, kind.element, axes, siso, kind.scales
    )


def _replace_derived(drawing: Drawing, number: int, kind: ModuleKind) -> None:
    """Read outputs that are fixed combinations of others, such as i_C = i_ti - i_g, from those."""
    for output, origins in derived_outputs(kind).items():
        users = [
            (key, weight) for key, weight in drawing.links.items() if key[:2] == (number, output)
        ]
        for key, weight in users:
            del drawing.links[key]
            for (side, port), matrix in origins.items():
                if side == "output":
                    drawing.add(number, port, key[2], key[3], weight @ matrix)
                    continue
                for source, inner in [
                    one for one in drawing.links.items() if one[0][2:] == (number, port)
                ]:
                    drawing.add(source[0], source[1], key[2], key[3], weight @ matrix @ inner)


def _wire_matrix(
    kind: ModuleKind, parameters: dict[str, str | float]
) -> dict[tuple[str, str], np.ndarray] | None:
    """(output, input) -> matrix of a memoryless kind without free parameters or context: a piece of
    wire.
    """
    fixed = {name: value for name, value in parameters.items() if isinstance(value, float)}
    if not kind.static or len(fixed) < len(parameters) or kind.context(1.0, (1.0, 0.0), {}):
        return None
    rows = np.array(kind.matrices(**fixed)[3], dtype=float).reshape(
        sum(signal.width for signal in kind.outputs.values()), -1
    )
    return {
        (output, port): columns.T
        for output, own in by_port(kind.outputs, rows).items()
        for port, columns in by_port(kind.inputs, own.T).items()
    }


# --- steps that need no more than the links; each returns whether it changed anything
# ---------------------------------


def _remove_idle(drawing: Drawing) -> bool:
    """Blocks that the terminal voltage does not reach, or that do not reach the terminal
    current.
    """
    graph = nx.DiGraph((source, target) for source, _, target, _ in drawing.links)
    graph.add_nodes_from(drawing.blocks)
    useful = nx.descendants(graph, 0) & nx.ancestors(graph, 1)
    idle = [
        number
        for number, block in drawing.blocks.items()
        if not block.outer and number not in useful
    ]
    for number in idle:
        drawing.remove(number)
    return bool(idle)


def _join_duplicates(drawing: Drawing) -> bool:
    """Two blocks of one law with the same inputs are one block."""
    seen: dict[tuple, int] = {}
    for number, block in list(drawing.blocks.items()):
        entering = tuple(
            sorted(
                (key[0], key[1], key[3], weight.tobytes()) for key, weight in drawing.into(number)
            )
        )
        law = (block.kind, block.parameters, entering)
        if block.outer:
            continue
        if law in seen:
            kept = seen[law]
            for key, weight in drawing.out_of(number):
                drawing.add(kept, key[1], key[2], key[3], weight)
            drawing.blocks[kept] = replace(
                drawing.blocks[kept], names=drawing.blocks[kept].names + block.names
            )
            drawing.remove(number)
            return True
        seen[law] = number
    return False
