"""The archive: islands in a ring, global elites, migration and eviction; pure, replayable, blind to the size of rewards."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ibrid.errors import IbridError
from search.merit import EXACT
from search.ranking import Entry, Ranking, RankLaw, front, rank
from search.settings import SearchSettings

__all__ = ["Archive", "Entry", "Statistics"]

#: A reward that rises by less is no gain: a free number less, or five percent of the error.
GAIN = 0.05
#: A beginning lasts at least this part of what it has brought so far without a gain.
LASTING = 1 / 3


@dataclass(frozen=True)
class Statistics:
    """Counts. `entries` : kept now, `unstable` of them. `admitted`, `repeated`, `invalid`, `evicted`, `migrations`, new
    `beginnings` : so far.

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
    beginnings: int
    natives: tuple[int, ...]
    guests: tuple[int, ...]


@dataclass(frozen=True)
class _Island:
    """Stable entries: its own, the neighbours' that it sees, and those together with the starts, for draws."""

    natives: Ranking = field(default_factory=Ranking)
    guests: Ranking = field(default_factory=Ranking)
    pool: Ranking = field(default_factory=Ranking)

    def trim(self, room: int) -> None:
        """Send away the guests that have no place among the first `room`, and more where its own best needs the place."""
        while self.guests and len(self.pool) > room:
            lowest = self.guests[-1]
            crowded = self.natives and self.pool.place(self.natives[0]) >= room
            if not crowded and self.pool.place(lowest) < room:
                return
            self.guests.discard(lowest)
            self.pool.discard(lowest)


@dataclass(frozen=True)
class _Field:
    """Stable entries that parents are drawn from: all, or since a new beginning those that it went back to and their like.

    `sorts` : by the sort of their control.
    """

    islands: tuple[_Island, ...]
    stable: Ranking = field(default_factory=Ranking)
    sorts: dict[str, Ranking] = field(default_factory=dict)

    def add(self, entry: Entry, homes: Sequence[Ranking]) -> None:
        """Add an entry, at home in these pools of islands."""
        for ranking in (self.stable, self.sorts.setdefault(entry.sort, Ranking()), *homes):
            ranking.add(entry)

    def discard(self, entry: Entry) -> None:
        """Take an entry out."""
        islands = [ranking for one in self.islands for ranking in (one.natives, one.guests, one.pool)]
        for ranking in (self.stable, *self.sorts.values(), *islands):
            ranking.discard(entry)


class Archive:
    """What a search has found, and where the next parent comes from.

    Each structure is kept once, under its hash, also when several islands see it. A structure that was evicted is not
    admitted again. An unstable one is kept but is no elite, no migrant, and a parent only in a draw from everything.
    When nothing has been gained for a while the draws go back halfway: to what is no better than the geometric mean of the
    errors of start and best, and what is born of that from then on. Nothing that was met is met again, so the way differs.
    Nothing depends on rewards but their order, save the draws along a front, which depend on the differences of its errors.
    """

    def __init__(self, settings: SearchSettings) -> None:
        self._settings = settings
        self._room = settings.population // settings.islands
        self._law = RankLaw(settings.rank_power, max(settings.elites, self._room), settings.crowding)
        self._met: set[str] = set()
        self._starts: set[str] = set()
        self._all, self._stable = Ranking(), Ranking()
        self._field = self._empty_field()
        self._born = self._barren = 0  # admitted since the last new beginning; of them since the last gain
        self._peak = -math.inf  # the reward that the next gain is measured from
        self._children: Counter[int] = Counter()
        self._counts: Counter[str] = Counter()

    def admit_start(self, entry: Entry) -> bool:
        """Admit a start: one entry, at home on every island, never evicted. False for a known hash or no finite reward."""
        if not self._admissible(entry):
            return False
        self._starts.add(entry.hash)
        self._insert(entry)
        return True

    def admit(self, entry: Entry) -> bool:
        """Admit an evaluated child to its island; every `sweep` admissions the islands show each other their best.

        False when nothing changed: a known hash, a reward that is not finite, or the worst entry of a full archive.
        Raises IbridError for an island that does not exist.
        """
        if not 0 <= entry.island < self._settings.islands:
            raise IbridError(f"an entry's island must be 0 to {self._settings.islands - 1}, found {entry.island}")
        if not self._admissible(entry):
            return False
        self._insert(entry)
        self._field.islands[entry.island].trim(self._room)
        if len(self) > self._settings.population and self._evict() is entry:
            return False
        if entry.parent is not None:
            self._children[entry.parent] += 1
        self._counts["admitted"] += 1
        if self._counts["admitted"] % self._settings.sweep == 0:
            self._migrate()
        self._watch(entry)
        return True

    def sample(self, rng: np.random.Generator, number: int) -> tuple[Entry, int]:
        """The parent for proposal `number`, and the island on which its child is native.

        A child stays on its parent's island, or, when the parent was drawn as a member of the active island, there: so
        a lineage crosses only by migration. The child of a start goes to the active island. An empty pool gives way to
        the elites, then to everything. Raises IbridError when there is nothing at all.
        """
        if not self._all:
            raise IbridError("the archive must hold an entry to draw a parent from, found none; admit the start first")
        settings, field, active = self._settings, self._field, number % self._settings.islands
        which, place, along, varied, among_sorts = rng.random(5)
        chosen = np.searchsorted(
            [settings.from_elites, settings.from_elites + settings.from_island], which, side="right"
        )
        if chosen == 1 and (pool := field.islands[active].pool):
            return self._law.draw(pool, place, self._room, self._children), active
        if chosen < 2 and field.stable:
            elites = self._drawn_sort(among_sorts) if varied < settings.variety else field.stable
            if along < settings.front:
                parent = self._law.draw_by_worth(self._front(elites), settings.front_power, place, self._children)
            else:
                parent = self._law.draw(elites, place, settings.elites, self._children)
        else:
            parent = self._all[int(place * len(self._all))]
        return parent, active if parent.hash in self._starts else parent.island

    @property
    def elites(self) -> tuple[Entry, ...]:
        """The stable entries of highest reward over all islands, best first; those before a new beginning too."""
        return self._stable.top(self._settings.elites)

    @property
    def front(self) -> tuple[Entry, ...]:
        """Of the stable entries that parents are drawn from those that nothing with fewer free parameters beats, fewest first;
        only the best of them."""
        return self._front(self._field.stable)

    @property
    def leader(self) -> Entry | None:
        """The best of those that parents are drawn from; before a new beginning the best."""
        return self._field.stable[0] if self._field.stable else None

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
        """What a draw from this island can give, best first: its own, its guests (at home elsewhere) and the starts."""
        return self._field.islands[number].pool.top(self._room)

    def statistics(self) -> Statistics:
        """Counts for the page and the log."""
        natives = Counter(one.island for one in self._all if one.hash not in self._starts)
        return Statistics(
            entries=len(self._all),
            unstable=len(self._all) - len(self._stable),
            elites=min(len(self._stable), self._settings.elites),
            natives=tuple(natives[number] for number in range(self._settings.islands)),
            guests=tuple(len(island.guests) for island in self._field.islands),
            **{
                name: self._counts[name]
                for name in ("admitted", "repeated", "invalid", "evicted", "migrations", "beginnings")
            },
        )

    def _front(self, elites: Ranking) -> tuple[Entry, ...]:
        return front(elites.top(self._settings.elites), self._settings.front_size)

    def _drawn_sort(self, place: float) -> Ranking:
        """The entries of a sort of control, drawn with probability proportional to 1 / the rank of its best among those of
        the others."""
        sorts = sorted((one for one in self._field.sorts.values() if one), key=lambda one: rank(one[0]))
        total = np.cumsum(1.0 / np.arange(1, len(sorts) + 1))
        return sorts[int(np.searchsorted(total, place * total[-1], side="right"))]

    def _admissible(self, entry: Entry) -> bool:
        if not math.isfinite(entry.reward):
            self._counts["invalid"] += 1
            return False
        if entry.hash in self._met:
            self._counts["repeated"] += 1
            return False
        return True

    def _insert(self, entry: Entry) -> None:
        self._met.add(entry.hash)
        self._all.add(entry)
        if entry.stable:
            self._stable.add(entry)
            self._place(entry)

    def _place(self, entry: Entry) -> None:
        """Let parents be drawn from an entry: a start on every island, a child on its own."""
        islands = self._field.islands
        if entry.hash in self._starts:
            self._field.add(entry, [island.pool for island in islands])
        else:
            self._field.add(entry, [islands[entry.island].natives, islands[entry.island].pool])

    def _empty_field(self) -> _Field:
        return _Field(tuple(_Island() for _ in range(self._settings.islands)))

    def _watch(self, entry: Entry) -> None:
        """Count the admissions without a gain, and begin anew when there were too many."""
        self._born, self._barren = self._born + 1, self._barren + 1
        if entry.stable and entry.reward > self._peak + GAIN:
            self._peak, self._barren = entry.reward, 0
        if self._barren > max(self._settings.barren, self._born * LASTING):
            self._begin_anew()

    def _begin_anew(self) -> None:
        """Go back halfway; children that were born before still count, so what they left is tried first."""
        starts = [one.nrmse for one in self._stable if one.hash in self._starts]
        least = min((one.nrmse for one in self._stable), default=EXACT)
        limit = math.sqrt(max(starts, default=1.0) * max(least, EXACT))
        self._field = self._empty_field()
        for entry in self._stable:
            if entry.nrmse >= limit or entry.hash in self._starts:
                self._place(entry)
        for island in self._field.islands:
            island.trim(self._room)
        self._born = self._barren = 0
        self._peak = self.leader.reward if self.leader else -math.inf
        self._counts["beginnings"] += 1

    def _evict(self) -> Entry:
        """Drop the lowest reward, of equal ones the least simple, but no start, no elite, no best of an island or a sort.

        In an archive that is too small to keep all those, the lowest that is no start.
        """
        homes = (*(island.natives for island in self._field.islands), *self._field.sorts.values())
        kept = self._starts | {home[0].hash for home in homes if home}
        kept |= {one.hash for one in (*self.elites, *self._field.stable.top(self._settings.elites))}
        found = (one for one in reversed(self._all) if one.hash not in kept)
        lowest = next(found, None) or next(one for one in reversed(self._all) if one.hash not in self._starts)
        for ranking in (self._all, self._stable):
            ranking.discard(lowest)
        self._field.discard(lowest)
        self._counts["evicted"] += 1
        return lowest

    def _migrate(self) -> None:
        """Show each island's best natives, as they are now, to both neighbours; a guest is never shown on."""
        islands = self._field.islands
        number = len(islands)
        share = self._settings.migrants
        shown = [island.natives.top(_part(len(island.natives), share)) for island in islands]
        for place, island in enumerate(islands):
            for neighbour in sorted({(place - 1) % number, (place + 1) % number} - {place}):
                for entry in shown[neighbour]:
                    island.guests.add(entry)
                    island.pool.add(entry)
            island.trim(self._room)
        self._counts["migrations"] += 1


def _part(number: int, share: float) -> int:
    """That share of a number, at least one unless the share is zero."""
    return max(1, round(share * number)) if share else 0
