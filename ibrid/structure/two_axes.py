"""Blocks on the two axes of a drawing: one on both axes, or two equal ones, whichever says it with fewer signals."""

from dataclasses import replace
from itertools import permutations

import numpy as np

from ibrid.structure.drawing import Drawing


def split_axes(drawing: Drawing) -> bool:
    """A block on both axes of which one axis is idle, or whose neighbours are all scalar, is scalar itself."""
    for number, block in list(drawing.blocks.items()):
        scalar = drawing.scalar_of.get(block.kind)
        if not block.axes or scalar is None:
            continue
        (port,), (output,) = block.inputs, block.outputs
        into, out = drawing.into(number), drawing.out_of(number)
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
        drawing.remove(number)
        for axis in live:
            fresh = number if axis == live[0] else max(drawing.blocks) + 1
            drawing.blocks[fresh] = replace(block, kind=scalar, inputs={port: 1}, outputs={output: 1}, axes=False)
            for key, weight in into:
                drawing.add(key[0], key[1], fresh, port, weight[[axis]])
            for key, weight in out:
                drawing.add(fresh, output, key[2], key[3], weight[:, [axis]])
        return True
    return False


def join_axes(drawing: Drawing) -> bool:
    """Equal scalar blocks on the d and the q channel of the same signals are one block on the pair."""
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
    """The far ports of a scalar block, each with the weight as a column on that port: upstream, downstream."""
    entering = [(key[:2], weight.T) for key, weight in drawing.into(number)]
    return entering, [(key[2:], weight) for key, weight in drawing.out_of(number)]


def _pack(drawing: Drawing, d: int, q: int) -> None:
    first, second = drawing.blocks[d], drawing.blocks[q]
    (port,), (output,) = first.inputs, first.outputs
    into = [(key, weight, axis) for axis, one in enumerate((d, q)) for key, weight in drawing.into(one)]
    out = [(key, weight, axis) for axis, one in enumerate((d, q)) for key, weight in drawing.out_of(one)]
    names = tuple(dict.fromkeys(first.names + second.names))
    drawing.remove(d)
    drawing.remove(q)
    kind = drawing.dq_of.setdefault(first.kind, f"{first.kind}_dq")
    drawing.scalar_of.setdefault(kind, first.kind)
    drawing.blocks[d] = replace(first, kind=kind, names=names, inputs={port: 2}, outputs={output: 2}, axes=True)
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
    """True when the first touches the d channel of those dq ports of which the second touches the q channel."""
    if not first or {port for port, _ in first} != {port for port, _ in second}:
        return False
    on_d = all(weight.shape[0] == 2 and not weight[1].any() for _, weight in first)
    return on_d and all(weight.shape[0] == 2 and not weight[0].any() for _, weight in second)
