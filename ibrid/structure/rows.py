"""Linear blocks in a row of a drawing: a PI regulator and an integrator behind it are a PLL, a free gain goes into its
neighbour, and the rest stand in one order."""

from dataclasses import replace

import numpy as np

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.structure.drawing import Block, Drawing, Key

_ORDER = {element: number for number, element in enumerate(Element)}


def join_plls(drawing: Drawing) -> bool:
    """A frequency from a PI, and the angle as its integral, are the two outputs of a phase-locked loop."""
    if drawing.pll is None:
        return False
    for angle, block in drawing.blocks.items():
        entering = drawing.into(angle)
        if block.element is not Element.INTEGRATOR or block.width != 1 or len(entering) != 1:
            continue
        ((regulator, output, _, _), weight) = entering[0]
        leaving = drawing.out_of(regulator)
        scalar_pi = drawing.blocks[regulator].element is Element.PI and drawing.blocks[regulator].width == 1
        if scalar_pi and len(leaving) > 1 and np.array_equal(weight, [[1.0]]):
            _join_pll(drawing, drawing.pll, regulator, output, angle)
            return True
    return False


def _join_pll(drawing: Drawing, pll: ModuleKind, regulator: int, frequency: str, angle: int) -> None:
    first, second = drawing.blocks[regulator], drawing.blocks[angle]
    (port,), (integral,) = first.inputs, second.outputs
    into = drawing.into(regulator)
    out = [(key, "delta_omega", weight) for key, weight in drawing.out_of(regulator) if key[2] != angle]
    out += [(key, "delta", weight) for key, weight in drawing.out_of(angle)]
    drawing.remove(angle)
    drawing.remove(regulator)
    drawing.blocks[regulator] = Block(
        pll.name,
        first.names + second.names,
        {"e_q": 1},
        {"delta_omega": 1, "delta": 1},
        tuple(zip(pll.parameters, (value for _, value in first.parameters), strict=True)),
        pll.element,
        scales=pll.scales,
    )
    own = {(regulator, frequency): "delta_omega", (angle, integral): "delta"}
    for key, weight in into:
        source = own.get(key[:2])
        drawing.add(regulator if source else key[0], source or key[1], regulator, "e_q", weight)
    for key, output, weight in out:
        if key[2:] != (regulator, port):  # a loop onto itself is among those that enter
            drawing.add(regulator, output, key[2], key[3], weight)


def drop_gains(drawing: Drawing) -> bool:
    """A free gain beside a block with a gain of its own goes into that."""
    for key in _in_a_row(drawing):
        for gain, other in ((key[0], key[2]), (key[2], key[0])):
            if drawing.blocks[gain].element is Element.GAIN and _scales(drawing, gain) and _scales(drawing, other):
                block = drawing.blocks[gain]
                (port,), (output,) = block.inputs, block.outputs
                drawing.blocks[other] = replace(drawing.blocks[other], names=drawing.blocks[other].names + block.names)
                return drawing.eliminate(gain, {(output, port): np.eye(block.width)})
    return False


def sort_rows(drawing: Drawing) -> bool:
    """Two linear blocks in a row change places where the order of elements says so."""
    for key in _in_a_row(drawing):
        first, second = drawing.blocks[key[0]], drawing.blocks[key[2]]
        weight = drawing.links[key]
        if not second.siso or _rank(first) <= _rank(second) or first.width != second.width:
            continue
        if Element.COUPLING in (first.element, second.element) and not np.array_equal(weight, weight[0, 0] * np.eye(2)):
            continue
        drawing.exchange(key[0], key[2])
        return True
    return False


def _in_a_row(drawing: Drawing) -> list[Key]:
    """Links that are the only one out of their source and the only one into their target, both linear blocks."""
    out, into = {}, {}
    for key in drawing.links:
        out.setdefault(key[0], []).append(key)
        into.setdefault(key[2], []).append(key)
    return [
        key
        for key in drawing.links
        if key[0] != key[2]
        and len(out[key[0]]) == len(into[key[2]]) == 1
        and drawing.blocks[key[0]].siso
        and (drawing.blocks[key[2]].siso or drawing.blocks[key[2]].element is Element.PLL)
    ]


def _scales(drawing: Drawing, number: int) -> bool:
    """True when the block's gain is free and its parameters belong to it alone."""
    block = drawing.blocks[number]
    words = {value for _, value in block.parameters}
    others = {value for other, one in drawing.blocks.items() if other != number for _, value in one.parameters}
    return block.scales and all(isinstance(word, str) for word in words) and not words & others


def _rank(block: Block) -> tuple[bool, int, str]:
    return not block.scales, _ORDER[block.element] if block.element else len(_ORDER), block.kind
