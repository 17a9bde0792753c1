"""The archive: islands in a ring, global elites, migration and eviction; pure, replayable, blind to
the size of rewards.
"""

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from ibrid.errors import IbridError
from ibrid_search.archives.ranking import Entry, Front, Ranking, RankLaw
from ibrid_search.screening.settings import SCREENING
from ibrid_search.settings import SearchSettings

__all__ = ["Archive", "Entry", "Statistics"]


@dataclass(frozen=True)
class Statistics:
    """Counts. `entries` : kept now, `unstable` of them. `admitted`, `repeated`, `invalid`,
    `evicted`, `migrations` : so far.

    `natives`, `guests` : for each island, its own entries and the neighbours' that it sees.
    """

    entries: int
    unstable: int
    elites: int
    admitted: int
    repeated: int
    invalid: int
    evicted: int
    migrations: int
    natives: tuple[int, ...]
    guests: tuple[int, ...]


@dataclass(frozen=True)
class _Island:
    """Stable entries: its own, the neighbours' that it sees, and those together with the starts,
    for draws.
    """

    natives: Ranking = field(default_factory=Ranking)
    guests: Ranking = field(default_factory=Ranking)
    pool: Ranking = field(default_factory=Ranking)

    def trim(self, room: int) -> None:
        """Send away the guests that have no place among the first `room`, and more where its own
        best needs the place.
        """
        while self.guests and len(self.pool) > room:
            lowest = self.guests[-1]
            crowded = self.natives and self.pool.place(self.natives[0]) >= room
            if not crowded and self.pool.place(lowest) < room:
                return
            self.guests.discard(lowest)
            self.pool.discard(lowest)


class Archive:
    """What a search has found, and where the next parent comes from.

    Each structure is kept once, under its hash, also when several islands see it. A structure that
    was evicted is not admitted again. An unstable one is kept but is no elite, no migrant, and a
    parent only in a draw from everything. Nothing depends on rewards but their order; draws among
    sorts of control depend on errors.
    """

    def __init__(self, settings: SearchSettings) -> None:
        self._settings = settings
        self._room = settings.population // settings.islands
        self._law = RankLaw(
            settings.rank_power, max(settings.elites, self._room), settings.crowding
        )
        self._met: set[str] = set()
        self._starts: set[str] = set()
        self._all, self._stable = Ranking(), Ranking()
        self._islands = tuple(_Island() for _ in range(settings.islands))
        self._front = Front()
        self._sorts: dict[str, Ranking] = {}
        self._least_error: dict[str, float] = {}
        self._children: Counter[int] = Counter()
        self._counts: Counter[str] = Counter()

    def admit_start(self, entry: Entry) -> bool:
        """Admit a start: one entry, at home on every island, never evicted. False for a known hash
        or no finite reward.
        """
        if not self._admissible(entry):
            return False
        self._starts.add(entry.hash)
        self._insert(entry, [island.pool for island in self._islands])
        return True

    def admit(self, entry: Entry) -> bool:
        """Admit an evaluated child to its island; every `sweep` admissions the islands show each
        other their best.

        False when nothing changed: a known hash, a reward that is not finite, or the worst entry of
        a full archive. Raises IbridError for an island that does not exist.
        """
        if not 0 <= entry.island < len(self._islands):
            raise IbridError(
                f"an entry's island must be 0 to {len(self._islands) - 1}, found {entry.island}"
            )
        if not self._admissible(entry):
            return False
        island = self._islands[entry.island]
        self._insert(entry, [island.natives, island.pool])
        island.trim(self._room)
        if len(self) > self._settings.population and self._evict() is entry:
            return False
        if entry.parent is not None:
            self._children[entry.parent] += 1
        self._counts["admitted"] += 1
        if self._counts["admitted"] % self._settings.sweep == 0:
            self._migrate()
        return True

    def sample(self, rng: np.random.Generator, number: int) -> tuple[Entry, int]:
        """The parent for proposal `number`, and the island on which its child is native.

        A child stays on its parent's island, or, when the parent was drawn as a member of the
        active island, there: so a lineage crosses only by migration. The child of a start goes to
        the active island. An empty pool gives way to the elites, then to everything. Raises
        IbridError when there is nothing at all.
        """
        if not self._all:
            raise IbridError(
                "the archive must hold an entry to draw a parent from, found none; admit the start "
                "first"
            )
        settings, active = self._settings, number % len(self._islands)
        which, place, along, varied, among_sorts = rng.random(5)
        chosen = np.searchsorted(
            [settings.from_elites, settings.from_elites + settings.from_island], which, side="right"
        )
        if chosen == 1 and (pool := self._islands[active].pool):
            return self._law.draw(pool, place, self._room, self._children), active
        if chosen < 2 and self._stable:
            if varied < settings.variety:
                parent = self._law.draw(
                    self._drawn_sort(among_sorts), place, settings.elites, self._children
                )
            elif along < settings.front:
                parent = self._law.draw_evenly(self.front, place, self._children)
            else:
                parent = self._law.draw(self._stable, place, settings.elites, self._children)
        else:
            parent = self._all[int(place * len(self._all))]
        return parent, active if parent.hash in self._starts else parent.island

    @property
    def elites(self) -> tuple[Entry, ...]:
        """The stable entries of highest reward over all islands, best first."""
        return self._stable.top(self._settings.elites)

    @property
    def front(self) -> tuple[Entry, ...]:
        """Of the stable entries those that nothing with fewer free parameters beats, fewest first;
        only the best of them.
        """
        return self._front.entries(self._settings.front_size)

    @property
    def best(self) -> Entry | None:
        """The stable entry of highest reward; of equal ones the simplest, then the earliest."""
        return self._stable[0] if self._stable else None

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All, best first, unstable ones among them."""
        return tuple(self._all)

    def __len__(self) -> int:
        return len(self._all)

    def island(self, number: int) -> tuple[Entry, ...]:
        """What a draw from this island can give, best first: its own, its guests (at home
        elsewhere) and the starts.
        """
        return self._islands[number].pool.top(self._room)

    def statistics(self) -> Statistics:
        """Counts for the page and the log."""
        natives = Counter(one.island for one in self._all if one.hash not in self._starts)
        return Statistics(
            entries=len(self._all),
            unstable=len(self._all) - len(self._stable),
            elites=min(len(self._stable), self._settings.elites),
            natives=tuple(natives[number] for number in range(len(self._islands))),
            guests=tuple(len(island.guests) for island in self._islands),
            **{
                name: self._counts[name]
                for name in ("admitted", "repeated", "invalid", "evicted", "migrations")
            },
        )

    def _drawn_sort(self, place: float) -> Ranking:
        """The entries of a sort of control, drawn with probability proportional to 1 / the least
        error it has had.
        """
        names = sorted(name for name, one in self._sorts.items() if one)
        total = np.cumsum(
            [1.0 / max(self._least_error[name], SCREENING.exact_error) for name in names]
        )
        return self._sorts[
            names[min(int(np.searchsorted(total, place * total[-1], side="right")), len(names) - 1)]
        ]

    def _admissible(self, entry: Entry) -> bool:
        if not math.isfinite(entry.reward):
            self._counts["invalid"] += 1
            return False
        if entry.hash in self._met:
            self._counts["repeated"] += 1
            return False
        return True

    def _insert(self, entry: Entry, homes: list[Ranking]) -> None:
        self._met.add(entry.hash)
        if entry.stable:
            self._front.add(entry)
            homes = [*homes, self._sorts.setdefault(entry.sort, Ranking())]
            self._least_error[entry.sort] = min(
                entry.nrmse, self._least_error.get(entry.sort, math.inf)
            )
        for ranking in [self._all, *([self._stable, *homes] if entry.stable else [])]:
            ranking.add(entry)

    def _evict(self) -> Entry:
        """Drop the lowest reward, of equal ones the least simple, but no start, no elite, no best
        of an island or a sort.

        In an archive that is too small to keep all those, the lowest that is no start.
        """
        homes = (*(island.natives for island in self._islands), *self._sorts.values())
        kept = self._starts | {home[0].hash for home in homes if home}
        kept |= {one.hash for one in (*self.elites, *(self.front if self._settings.front else ()))}
        found = (one for one in reversed(self._all) if one.hash not in kept)
        lowest = next(found, None) or next(
            one for one in reversed(self._all) if one.hash not in self._starts
        )
        for ranking in (self._all, self._stable, *homes):
            ranking.discard(lowest)
        for island in self._islands:
            island.guests.discard(lowest)
            island.pool.discard(lowest)
        self._counts["evicted"] += 1
        return lowest

    def _migrate(self) -> None:
        """Show each island's best natives, as they are now, to both neighbours; a guest is never
        shown on.
        """
        number = len(self._islands)
        share = self._settings.migrants
        shown = [
            island.natives.top(max(1, round(share * len(island.natives))) if share else 0)
            for island in self._islands
        ]
        for place, island in enumerate(self._islands):
            for neighbour in sorted({(place - 1) % number, (place + 1) % number} - {place}):
                for entry in shown[neighbour]:
                    island.guests.add(entry)
                    island.pool.add(entry)
            island.trim(self._room)
        self._counts["migrations"] += 1
