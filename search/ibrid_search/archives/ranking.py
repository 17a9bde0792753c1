"""Entries of the archive in order, best first: kept sorted as they come and go, and drawn by
rank.
"""

from bisect import bisect_left, insort
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Entry:
    """An evaluated structure. `step` : that made it. `parent` : step of its parent. `island` :
    where it is native.

    `reward` : what it ranks by. `value` : the same without the price of its free numbers; None: the
    reward. `sort` : of control, by which an engineer would call it, and whether its plant has
    absurd values.
    """

    step: int
    hash: str
    parent: int | None
    island: int
    reward: float
    nrmse: float
    order: int
    free: int
    stable: bool
    program: str
    value: float | None = None
    sort: str = ""

    @property
    def plain(self) -> float:
        """What the front weighs against the free numbers."""
        return self.reward if self.value is None else self.value


class Ranking:
    """Entries by reward, the highest first; of equal ones those with fewer free parameters, of
    lower order, earlier.
    """

    def __init__(self) -> None:
        self._keys: list[tuple[Any, ...]] = []

    def __len__(self) -> int:
        return len(self._keys)

    def __getitem__(self, place: int) -> Entry:
        return self._keys[place][-1]

    def __iter__(self) -> Iterator[Entry]:
        return (key[-1] for key in self._keys)

    def __reversed__(self) -> Iterator[Entry]:
        return (key[-1] for key in reversed(self._keys))

    def __contains__(self, entry: Entry) -> bool:
        place = self.place(entry)
        return place < len(self._keys) and self[place].hash == entry.hash

    def place(self, entry: Entry) -> int:
        """Number of entries before this one, whether it is here or not."""
        return bisect_left(self._keys, _key(entry))

    def top(self, number: int) -> tuple[Entry, ...]:
        """The best ones, at most `number`."""
        return tuple(key[-1] for key in self._keys[:number])

    def add(self, entry: Entry) -> None:
        """Put an entry in its place, unless it is there."""
        if entry not in self:
            insort(self._keys, (*_key(entry), entry))

    def discard(self, entry: Entry) -> None:
        """Take an entry out, when it is there."""
        if entry in self:
            del self._keys[self.place(entry)]


class RankLaw:
    """Draws with probability proportional to rank^-power / (1 + children / crowding).

    Power 0 is uniform in rank; crowding infinity forgets the children. `most` : entries that it can
    tell apart.
    """

    def __init__(self, power: float, most: int, crowding: float) -> None:
        self._weight = np.arange(1, most + 1, dtype=float) ** -power
        self._most, self._crowding = most, crowding

    def draw(self, ranking: Ranking, place: float, most: int, children: Mapping[int, int]) -> Entry:
        """The entry at a place in [0, 1) of the distribution over the first `most` of a ranking
        that is not empty.

        children : step -> admitted children, 0 where it is missing.
        """
        pool = ranking.top(min(most, self._most))
        return self._drawn(pool, self._weight[: len(pool)], place, children)

    def draw_evenly(
        self, pool: Sequence[Entry], place: float, children: Mapping[int, int]
    ) -> Entry:
        """The same from a few entries, whatever their rank."""
        return self._drawn(pool, np.ones(len(pool)), place, children)

    def _drawn(
        self, pool: Sequence[Entry], weight: np.ndarray, place: float, children: Mapping[int, int]
    ) -> Entry:
        born = np.array([children.get(one.step, 0) for one in pool])
        total = np.cumsum(weight / (1.0 + born / self._crowding))
        return pool[
            min(int(np.searchsorted(total, place * total[-1], side="right")), len(pool) - 1)
        ]


class Front:
    """For every number of free parameters the best entry, where it beats all that have fewer."""

    def __init__(self) -> None:
        self._best: dict[int, Entry] = {}

    def add(self, entry: Entry) -> None:
        """Take note of an entry."""
        before = self._best.get(entry.free)
        if before is None or (-entry.plain, entry.order, entry.step) < (
            -before.plain,
            before.order,
            before.step,
        ):
            self._best[entry.free] = entry

    def entries(self, most: int) -> tuple[Entry, ...]:
        """The front, fewest parameters first; at most that many, those of the highest values."""
        front: list[Entry] = []
        for free in sorted(self._best):
            if not front or self._best[free].plain > front[-1].plain:
                front.append(self._best[free])
        return tuple(front[-most:])


def _key(entry: Entry) -> tuple[Any, ...]:
    return -entry.reward, entry.free, entry.order, entry.step, entry.hash
