"""The pairing of blocks of two rewritten diagrams that keeps most links; blocks pair with blocks of
their kind only.

Few pairings are possible in most diagrams, and then all are tried. Otherwise: similarity of
neighbourhoods, assignment, and exchanges while they help, from both sides.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations
from math import perm, prod

import numpy as np
from scipy.optimize import linear_sum_assignment

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.structure.comparison.drawing import Block, Key
from ibrid.structure.comparison.simplify import Simplified

Unknown = tuple[int, str, int]  # block, port, channel
Equation = tuple[tuple[Unknown, ...], int]  # the sum of the unknowns modulo 2


class Parity:
    """Equations modulo 2, taken in one by one; one that contradicts the others is refused."""

    def __init__(self) -> None:
        self._place: dict[Unknown, int] = {}
        self._rows: dict[int, int] = {}  # highest bit -> row; bit 0 is the right-hand side

    def take(self, equations: Iterable[Equation]) -> bool:
        """Add all equations, or none of them and return False when they contradict what is
        known.
        """
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
    if block.element in (
        Element.POWER,
        Element.DC_LINK,
    ):  # a product: each factor may change its sign
        first, second = (_channels(number, port, ports[port]) for port in block.inputs)
        products = [(number, port, 0) for port in block.outputs]
        return [
            *_equal(first),
            *_equal(second),
            *_equal(products),
            ((first[0], second[0], products[0]), 0),
        ]
    if block.element is Element.MAGNITUDE:
        (entry,), (output,) = block.inputs, block.outputs
        return [*_equal(_channels(number, entry, 2)), (((number, output, 0),), 0)]
    if block.element in (
        *ROTATIONS,
        Element.COUPLING_AT_FREQUENCY,
    ):  # the product with them follows the vector
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


#: So many pairings are tried one by one.
MOST_PAIRINGS = 800
#: Links looked at while exchanges are tried from one start; some thousand exchanges in a diagram of
#: drawn size.
MOST_LINKS = 150_000
ROUNDS = 8

Classes = list[tuple[list[int], list[int]]]  # blocks of one kind, of both drawings
Pairing = dict[int, int]  # block of the first -> block of the second


@dataclass(frozen=True)
class Matching:
    """`pairs` : blocks of the first and the second, outer ones left out.

    `links` : number of links in common.
    """

    pairs: tuple[tuple[int, int], ...]
    links: int


def best_matching(first: Simplified, second: Simplified) -> Matching:
    """Pair the blocks of two diagrams; the counts do not depend on which is the first."""
    scorer = _Scorer(first, second)
    classes = _classes(first, second)
    pairing = next(
        _all_pairings(classes)
    )  # in canonical order: exact for diagrams of one structure
    number = prod(perm(max(len(a), len(b)), min(len(a), len(b))) for a, b in classes)
    if scorer.links(pairing) == min(len(first.links), len(second.links)):
        pass
    elif number <= MOST_PAIRINGS:
        pairing = max(_all_pairings(classes), key=scorer.links)
    else:
        swapped = [(b, a) for a, b in classes]
        back = {a: b for b, a in _assigned(second, first, swapped).items()}
        starts = (pairing, _assigned(first, second, classes), back)
        pairing = max((_improved(start, classes, scorer) for start in starts), key=scorer.links)
    own = sorted((a, b) for a, b in pairing.items() if not first.blocks[a].outer)
    return Matching(tuple(own), scorer.links(pairing))


def _classes(first: Simplified, second: Simplified) -> Classes:
    kinds = sorted(
        {block.kind for block in first.blocks.values()}
        & {block.kind for block in second.blocks.values()}
    )
    return [
        (
            [number for number, block in first.blocks.items() if block.kind == kind],
            [number for number, block in second.blocks.items() if block.kind == kind],
        )
        for kind in kinds
    ]


def _all_pairings(classes: Classes) -> Iterator[Pairing]:
    """Every way to give each block of the smaller group a partner of its own, class by class."""
    if not classes:
        yield {}
        return
    (a, b), rest = classes[0], classes[1:]
    if len(a) <= len(b):
        ways = (zip(a, chosen, strict=True) for chosen in permutations(b, len(a)))
    else:
        ways = (zip(chosen, b, strict=True) for chosen in permutations(a, len(b)))
    for way in ways:
        chosen = dict(way)
        for others in _all_pairings(rest):
            yield chosen | others


class _Scorer:
    """Counts the links that a pairing keeps: same ports, same channels, and signs that agree up to
    the gauge.
    """

    def __init__(self, first: Simplified, second: Simplified) -> None:
        self.first, self.second = first, second
        self.laws = {number: law_equations(number, block) for number, block in first.blocks.items()}

    def links(self, pairing: Pairing) -> int:
        common = []
        for key, weight in self.first.links.items():
            if key[0] not in pairing or key[2] not in pairing:
                continue
            other = (pairing[key[0]], key[1], pairing[key[2]], key[3])
            found = self.second.links.get(other)
            if found is not None and np.array_equal(weight != 0, found != 0):
                common.append((key, other, _sign_equations(key, weight, found)))
        forward = self._consistent(pairing, [equations for *_, equations in common])
        if forward == len(common):
            return forward
        places = {key: place for place, key in enumerate(self.second.links)}
        backward = [equations for *_, equations in sorted(common, key=lambda one: places[one[1]])]
        return max(forward, self._consistent(pairing, backward))

    def _consistent(self, pairing: Pairing, links: list[list[Equation]]) -> int:
        parity = Parity()
        for number in pairing:
            parity.take(self.laws[number])
        return sum(parity.take(equations) for equations in links)


def _sign_equations(key: Key, weight: np.ndarray, other: np.ndarray) -> list[Equation]:
    source, output, target, port = key
    return [
        (
            ((target, port, int(row)), (source, output, int(column))),
            int(weight[row, column] * other[row, column] < 0),
        )
        for row, column in np.argwhere(weight != 0)
    ]


def _assigned(first: Simplified, second: Simplified, classes: Classes) -> Pairing:
    """Blocks of one kind paired by how alike their surroundings are, a few steps out."""
    alike = {(a, b): 1.0 for group_a, group_b in classes for a in group_a for b in group_b}
    around, beyond = _neighbours(first), _neighbours(second)
    for _ in range(ROUNDS):
        fresh = {}
        for a, b in alike:
            near, far = around.get(a, {}), beyond.get(b, {})
            total = sum(
                max((alike.get((x, y), 0.0) for x in near[label] for y in far[label]), default=0.0)
                for label in near.keys() & far.keys()
            )
            size = max(len(near), len(far), 1)
            fresh[a, b] = 0.5 + 0.5 * total / size
        alike = fresh
    pairing: Pairing = {}
    for group_a, group_b in classes:
        table = np.array([[alike[a, b] for b in group_b] for a in group_a])
        rows, columns = linear_sum_assignment(-table)
        pairing |= {
            group_a[row]: group_b[column] for row, column in zip(rows, columns, strict=True)
        }
    return pairing


def _neighbours(drawing: Simplified) -> dict[int, dict[tuple, list[int]]]:
    neighbours: dict[int, dict[tuple, list[int]]] = {}
    for (source, output, target, port), weight in drawing.links.items():
        pattern = (weight != 0).tobytes()
        neighbours.setdefault(source, {}).setdefault(("out", output, port, pattern), []).append(
            target
        )
        neighbours.setdefault(target, {}).setdefault(("in", output, port, pattern), []).append(
            source
        )
    return neighbours


def _improved(pairing: Pairing, classes: Classes, scorer: _Scorer) -> Pairing:
    """Exchange partners within a kind, or bring in one without a partner, while that keeps more
    links.
    """
    best = scorer.links(pairing)
    left = MOST_LINKS // (len(scorer.first.links) + len(scorer.second.links) + 1)
    improved = True
    while improved:
        improved = False
        for group_a, group_b in classes:
            for candidate in _exchanges(pairing, group_a, group_b):
                if left == 0:
                    return pairing
                left -= 1
                links = scorer.links(candidate)
                if links > best:
                    pairing, best, improved = candidate, links, True
                    break
    return pairing


def _exchanges(pairing: Pairing, group_a: list[int], group_b: list[int]) -> Iterator[Pairing]:
    free = [b for b in group_b if b not in pairing.values()]
    paired = [a for a in group_a if a in pairing]
    for index, a in enumerate(paired):
        for other in paired[index + 1 :]:
            yield pairing | {a: pairing[other], other: pairing[a]}
        for b in free:
            yield pairing | {a: b}
        for other in group_a:
            if other not in pairing:
                moved = {one: b for one, b in pairing.items() if one != a}
                yield moved | {other: pairing[a]}
