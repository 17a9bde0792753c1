"""Steps that `simplify` takes with the linear blocks of a drawing.

In a row: a PI regulator and an integrator behind it are a PLL, a free gain goes into its neighbour,
and the rest stand in one order. On the two axes: one block on both, or two equal ones, whichever
says it with fewer signals.
"""

from collections import Counter
from dataclasses import replace
from itertools import permutations

import numpy as np

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.structure.comparison.drawing import Block, Drawing, Key

_ORDER = {element: number for number, element in enumerate(Element)}


# --- in a row
# ----------------------------------------------------------------------------------------------


def join_plls(drawing: Drawing) -> bool:
    """A frequency from a PI, and the angle as its integral, are the two outputs of a phase-locked
    loop.
    """
    if drawing.pll is None:
        return False
    for angle, block in drawing.blocks.items():
        entering = drawing.into(angle)
        if block.element is not Element.INTEGRATOR or block.width != 1 or len(entering) != 1:
            continue
        ((regulator, output, _, _), weight) = entering[0]
        leaving = drawing.out_of(regulator)
        scalar_pi = (
            drawing.blocks[regulator].element is Element.PI and drawing.blocks[regulator].width == 1
        )
        if scalar_pi and len(leaving) > 1 and np.array_equal(weight, [[1.0]]):
            _join_pll(drawing, drawing.pll, regulator, output, angle)
            return True
    return False


def _join_pll(
    drawing: Drawing, pll: ModuleKind, regulator: int, frequency: str, angle: int
) -> None:
    first, second = drawing.blocks[regulator], drawing.blocks[angle]
    (port,), (integral,) = first.inputs, second.outputs
    into = drawing.into(regulator)
    out = [
        (key, "delta_omega", weight) for key, weight in drawing.out_of(regulator) if key[2] != angle
    ]
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
            if (
                drawing.blocks[gain].element is Element.GAIN
                and _scales(drawing, gain)
                and _scales(drawing, other)
            ):
                block = drawing.blocks[gain]
                (port,), (output,) = block.inputs, block.outputs
                drawing.blocks[other] = replace(
                    drawing.blocks[other], names=drawing.blocks[other].names + block.names
                )
                return drawing.eliminate(gain, {(output, port): np.eye(block.width)})
    return False


def sort_rows(drawing: Drawing) -> bool:
    """Two linear blocks in a row change places where the order of elements says so."""
    for key in _in_a_row(drawing):
        first, second = drawing.blocks[key[0]], drawing.blocks[key[2]]
        weight = drawing.links[key]
        if not second.siso or _rank(first) <= _rank(second) or first.width != second.width:
            continue
        if Element.COUPLING in (first.element, second.element) and not np.array_equal(
            weight, weight[0, 0] * np.eye(2)
        ):
            continue
        drawing.exchange(key[0], key[2])
        return True
    return False


def _in_a_row(drawing: Drawing) -> list[Key]:
    """Links that are the only one out of their source and the only one into their target, both
    linear blocks.
    """
    out, into = (Counter(key[place] for key in drawing.links) for place in (0, 2))
    return [
        key
        for key in drawing.links
        if key[0] != key[2]
        and out[key[0]] == into[key[2]] == 1
        and drawing.blocks[key[0]].siso
        and (drawing.blocks[key[2]].siso or drawing.blocks[key[2]].element is Element.PLL)
    ]


def _scales(drawing: Drawing, number: int) -> bool:
    """True when the block's gain is free and its parameters belong to it alone."""
    block = drawing.blocks[number]
    words = {value for _, value in block.parameters}
    others = {
        value
        for other, one in drawing.blocks.items()
        if other != number
        for _, value in one.parameters
    }
    return block.scales and all(isinstance(word, str) for word in words) and not words & others


def _rank(block: Block) -> tuple[bool, int, str]:
    return not block.scales, _ORDER[block.element] if block.element else len(_ORDER), block.kind


# --- on the two axes
# ----------------------------------------------------------------------------------------------


def split_axes(drawing: Drawing) -> bool:
    """A block on both axes of which one axis is idle, or whose neighbours are all scalar, is scalar
    itself.
    """
    for number, block in list(drawing.blocks.items()):
        scalar = drawing.scalar_of.get(block.kind)
        if not block.axes or scalar is None:
            continue
        (port,), (output,) = block.inputs, block.outputs
        into, out = drawing.into(number), drawing.out_of(number)
        live = [
            axis
            for axis in (0, 1)
            if any(weight[axis].any() for _, weight in into)
            and any(weight[:, axis].any() for _, weight in out)
        ]
        scalar_around = all(weight.shape[1] == 1 for _, weight in into) and all(
            weight.shape[0] == 1 for _, weight in out
        )
        looped = any(key[0] == number for key, _ in into)
        if looped or (len(live) == 2 and not scalar_around):
            continue
        drawing.remove(number)
        for axis in live:
            fresh = number if axis == live[0] else max(drawing.blocks) + 1
            drawing.blocks[fresh] = replace(
                block, kind=scalar, inputs={port: 1}, outputs={output: 1}, axes=False
            )
            for key, weight in into:
                drawing.add(key[0], key[1], fresh, port, weight[[axis]])
            for key, weight in out:
                drawing.add(fresh, output, key[2], key[3], weight[:, [axis]])
        return True
    return False


def join_axes(drawing: Drawing) -> bool:
    """Equal scalar blocks on the d and the q channel of the same signals are one block on the
    pair.
    """
    scalars: dict[tuple, list[int]] = {}
    for number, block in drawing.blocks.items():
        if block.siso and block.width == 1:
            scalars.setdefault((block.kind, block.parameters), []).append(number)
    for alike in scalars.values():
        ends = {one: _ends(drawing, one) for one in alike} if len(alike) > 1 else {}
        for d, q in permutations(ends, 2):
            if _opposite_axes(ends[d][1], ends[q][1]) or _opposite_axes(ends[d][0], ends[q][0]):
                _pack(drawing, d, q)
                return True
    return False


def _ends(drawing: Drawing, number: int) -> tuple[list, list]:
    """The far ports of a scalar block, each with the weight as a column on that port: upstream,
    downstream.
    """
    entering = [(key[:2], weight.T) for key, weight in drawing.into(number)]
    return entering, [(key[2:], weight) for key, weight in drawing.out_of(number)]


def _pack(drawing: Drawing, d: int, q: int) -> None:
    first, second = drawing.blocks[d], drawing.blocks[q]
    (port,), (output,) = first.inputs, first.outputs
    into = [
        (key, weight, axis) for axis, one in enumerate((d, q)) for key, weight in drawing.into(one)
    ]
    out = [
        (key, weight, axis)
        for axis, one in enumerate((d, q))
        for key, weight in drawing.out_of(one)
    ]
    names = tuple(dict.fromkeys(first.names + second.names))
    drawing.remove(d)
    drawing.remove(q)
    kind = drawing.dq_of.setdefault(first.kind, f"{first.kind}_dq")
    drawing.scalar_of.setdefault(kind, first.kind)
    drawing.blocks[d] = replace(
        first, kind=kind, names=names, inputs={port: 2}, outputs={output: 2}, axes=True
    )
    unit = np.eye(2)
    for key, weight, axis in into:
        if key[0] not in (d, q):
            drawing.add(key[0], key[1], d, port, unit[:, [axis]] @ weight)
    for key, weight, axis in out:
        spread = weight @ unit[[axis]]
        if key[2] in (d, q):
            spread = unit[:, [(d, q).index(key[2])]] @ spread
            drawing.add(d, output, d, port, spread)
        else:
            drawing.add(d, output, key[2], key[3], spread)


def _opposite_axes(first: list, second: list) -> bool:
    """True when the first touches the d channel of those dq ports of which the second touches the q
    channel.
    """
    if not first or {port for port, _ in first} != {port for port, _ in second}:
        return False
    on_d = all(weight.shape[0] == 2 and not weight[1].any() for _, weight in first)
    return on_d and all(weight.shape[0] == 2 and not weight[0].any() for _, weight in second)
