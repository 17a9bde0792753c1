"""Which signs of two drawings may differ: a block whose input and output both change sign is the same block.

Every channel of every port of a matched block has one unknown, 1 where the second drawing carries the signal with the
opposite sign. The laws of the blocks and the signs on the links are equations in these unknowns modulo 2.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.structure.drawing import Block

Unknown = tuple[int, str, int]  # block, port, channel
Equation = tuple[tuple[Unknown, ...], int]  # the sum of the unknowns modulo 2


class Parity:
    """Equations modulo 2, taken in one by one; one that contradicts the others is refused."""

    def __init__(self) -> None:
        self._place: dict[Unknown, int] = {}
        self._rows: dict[int, int] = {}  # highest bit -> row; bit 0 is the right-hand side

    def take(self, equations: Iterable[Equation]) -> bool:
        """Add all equations, or none of them and return False when they contradict what is known."""
        before = dict(self._rows)
        for unknowns, parity in equations:
            row = parity & 1
            for unknown in unknowns:
                row ^= 2 << self._place.setdefault(unknown, len(self._place))
            while row > 1 and (top := row.bit_length()) in self._rows:
                row ^= self._rows[top]
            if row == 1:
                self._rows = before
                return False
            if row:
                self._rows[row.bit_length()] = row
        return True


def law_equations(number: int, block: Block) -> list[Equation]:
    """Sign changes that leave a block's law as it is."""
    ports = {**block.inputs, **block.outputs}
    every = [(number, port, channel) for port, width in ports.items() for channel in range(width)]
    if block.outer or block.element is Element.FILTER:
        return [((unknown,), 0) for unknown in every]
    if block.element in (Element.POWER, Element.DC_LINK):  # a product: each factor may change its sign
        first, second = (_channels(number, port, ports[port]) for port in block.inputs)
        products = [(number, port, 0) for port in block.outputs]
        return [*_equal(first), *_equal(second), *_equal(products), ((first[0], second[0], products[0]), 0)]
    if block.element is Element.MAGNITUDE:
        (entry,), (output,) = block.inputs, block.outputs
        return [*_equal(_channels(number, entry, 2)), (((number, output, 0),), 0)]
    if block.element in (
        *ROTATIONS,
        Element.COUPLING_AT_FREQUENCY,
    ):  # the product with angle or frequency follows the vector
        deviations = [unknown for unknown in every if ports[unknown[1]] == 1]
        vectors = [unknown for unknown in every if ports[unknown[1]] == 2]
        return [*_equal(vectors), *(((unknown,), 0) for unknown in deviations)]
    if block.element is Element.GAIN and block.width == 1:  # its number takes either sign
        return []
    if block.axes or block.element is Element.COUPLING:
        (entry,), (output,) = block.inputs, block.outputs
        d_in, q_in = _channels(number, entry, 2)
        d_out, q_out = _channels(number, output, 2)
        if block.element is Element.COUPLING:
            d_out, q_out = q_out, d_out
        if block.element is Element.GAIN:
            return [((d_in, d_out, q_in, q_out), 0)]
        return [((d_in, d_out), 0), ((q_in, q_out), 0)]
    return _equal(every)


def _channels(number: int, port: str, width: int) -> list[Unknown]:
    return [(number, port, channel) for channel in range(width)]


def _equal(unknowns: Sequence[Unknown]) -> list[Equation]:
    return [((one, other), 0) for one, other in pairwise(unknowns)]
