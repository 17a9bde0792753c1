"""What a search is after, where it runs, and every number of it, with the paper's values where it
gives them.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Integral
from types import MappingProxyType
from typing import Any

from ibrid.border import methods_take_kinds, require_kinds
from ibrid.errors import IbridError
from ibrid.fit.settings import EFFORTS
from ibrid.frozen import Frozen
from ibrid.hanging import PROCESSOR_LIMIT
from ibrid_search.evaluated import SCALES
from ibrid_search.requirements import Requirements, parse_requirements

#: Ways to choose the answer.
WAYS = ("plausible", "error", "frequencies", "op")


@methods_take_kinds
@dataclass(frozen=True)
class Goal:
    """What a search is after, and what it may take.

    `budget` : evaluations at most, the start included. `target` : NRMSE that ends the search; None:
    only the noise floor or an exact fit does. `require` : "stable", "passive:LO-HI", joined by
    commas; what does not meet it is not admitted. `choose` : the answer by "error", held-out
    "frequencies", held-out operating points ("op"), or those where there are any ("plausible").

    Raises IbridError for a number that means nothing, and words that are none of these.
    """

    budget: int = 500
    target: float | None = None
    require: str = ""
    choose: str = "plausible"

    def __post_init__(self) -> None:
        require_kinds(self)
        _ = self.requirements  # words that are not understood end the search here
        counts = isinstance(self.budget, Integral) and self.budget >= 1
        for holds, sentence in (
            (
                counts,
                f"budget must be 1 evaluation or more, and a whole number, found {self.budget}",
            ),
            (
                self.target is None or self.target > 0,
                f"target must be an NRMSE above zero, found {self.target}",
            ),
            (
                self.choose in WAYS,
                f"the answer is chosen by {', '.join(WAYS)}, found {self.choose!r}",
            ),
        ):
            if not holds:
                raise IbridError(sentence)

    @cached_property
    def requirements(self) -> Requirements:
        """What `require` says."""
        return parse_requirements(self.require)


#: Workers of one core that a search has at most; several clusters' worth.
MOST_WORKERS = 1000


@methods_take_kinds
@dataclass(frozen=True)
class Workers:
    """Where candidates are evaluated. `number` : 1 evaluates in this process, more in as many
    processes of this machine.
    `ray` : address of a Ray cluster, "auto" or "HEAD:6379"; "local" is a Ray of one's own here;
    None: none.

    Raises IbridError for less than one, or more than MOST_WORKERS.
    """

    number: int = 1
    ray: str | None = None

    def __post_init__(self) -> None:
        require_kinds(self)
        if not isinstance(self.number, Integral) or not 1 <= self.number <= MOST_WORKERS:
            raise IbridError(
                f"workers must be a whole number from 1 to {MOST_WORKERS}, found "
                f"{self.number if abs(self.number) < 1e9 else 'far more'}"
            )


@methods_take_kinds
@dataclass(frozen=True)
class SearchSettings(Frozen):
    """How a run samples, admits, evaluates and ends.

    Archive (paper, section V.A): `population` : most candidates kept. `islands` : in a ring.
    `elites` : highest rewards over all islands. `from_elites`, `from_island` : share of parents
    from the elites and from the active island; the rest from everything. `sweep` : admissions
    between migrations. `migrants` : share of an island that its neighbours get to see.
    `rank_power`, `crowding` : parents are drawn with probability rank^-rank_power / (1 + children /
    crowding) among elites and within islands; 0 and infinity for all alike. `variety` : share of
    the draws from the elites that are made among the sorts of control (what makes the frequency, a
    voltage loop, an absurd plant), in proportion to 1 / the least error of each: another sort may
    need several edits before it is better, and an absurd plant may be one edit away from the right
    diagram. `front` : of the rest, the share along the front of error against free parameters, its
    `front_size` entries of least error.
    `parsimony` : what a free number must gain in ln(NRMSE), per operating point that has its own,
    to keep its rank.
    `layer` : what a missing control layer (synchronisation, inner loop, outer loops) costs a
    parent's rank, in ln(NRMSE). `bound`, `residual` : the same for a parameter at the end of its
    box and for a residual module (notch, Pade).

    Edits: `scales` : probability of local, module and structural. `pruning` : share of the steps
    that try to take something away from the best. `history` : best candidates and last failures
    that a proposer sees; None: as it wants.

    Loop: `devices` : inverters behind the terminals, 1 or 2: with 1 no second one is proposed,
    unless the start has two; with 2 the shipped diagrams of two are begun from where no start is
    given. `starts` : of these at most. `window` : proposal k sees the results up to k - window, so
    the archive does not depend on the number of workers.
    `final_pruning` : share of the budget kept for taking away at the end what does not pay.
    `patience` : proposals in a row without a new structure that end the search. `settled` : steps
    for which the best must stay the best before the search ends at a noise floor, since a wrong
    structure may reach it by luck. `lost` : tries of a candidate whose workers die; it is tried
    again when the run goes on. `effort` : of the fits of a candidate, "low", "normal" or "high".
    `processor_limit` : processor seconds after which the worker of a candidate is taken for one
    that hangs and ended: a safety net, no budget.

    Raises IbridError for a number that means nothing.
    """

    population: int = 10_000
    islands: int = 10
    elites: int = 200
    from_elites: float = 0.6
    from_island: float = 0.2
    sweep: int = 1_000
    migrants: float = 0.1
    rank_power: float = 2.0
    crowding: float = 10.0
    front: float = 1.0
    front_size: int = 8
    variety: float = 0.25
    parsimony: float = 0.05
    layer: float = 3.0
    bound: float = 0.3
    residual: float = 0.3
    scales: Mapping[str, float] = field(
        default_factory=lambda: MappingProxyType({"local": 0.3, "module": 0.4, "structural": 0.3})
    )
    pruning: float = 0.15
    history: int | None = None
    devices: int = 1
    starts: int = 5
    window: int = 8
    final_pruning: float = 0.1
    patience: int = 200
    settled: int = 300
    lost: int = 3
    effort: str = "normal"
    processor_limit: float = PROCESSOR_LIMIT

    def __post_init__(self) -> None:
        super().__post_init__()
        require_kinds(self)
        for holds, law, found in _laws(self):
            if not holds:
                raise IbridError(f"{law}, found {found}; change it in the settings of the search")


#: Settings that are shares; the least value of counts; where a zero elsewhere is meant by none.
_SHARES = ("migrants", "from_elites", "from_island", "front", "variety", "pruning", "final_pruning")
_LEAST = {
    "islands": 1,
    "elites": 1,
    "sweep": 1,
    "front_size": 1,
    "starts": 1,
    "history": 0,
    "window": 1,
    "patience": 1,
    "settled": 0,
}
_OFF = {
    "sweep": " (migrants = 0 switches migration off)",
    "front_size": " (front = 0 switches it off)",
}


def _laws(settings: SearchSettings) -> Iterator[tuple[bool, str, Any]]:
    """Whether a law holds, the law in words, and what was found."""
    for name, least in _LEAST.items():
        found = getattr(settings, name)
        yield (found or 0) >= least, f"{name} must be {least} or more{_OFF.get(name, '')}", found
    for name in _SHARES:
        yield (
            0 <= getattr(settings, name) <= 1,
            f"{name} must be a share from 0 to 1",
            getattr(settings, name),
        )
    yield settings.effort in EFFORTS, f"effort must be one of {', '.join(EFFORTS)}", settings.effort
    yield (
        settings.processor_limit > 0,
        "processor_limit must be above 0 s",
        settings.processor_limit,
    )
    yield (
        settings.devices in (1, 2),
        "devices behind the terminals must be 1 or 2",
        settings.devices,
    )
    drawn, scales = settings.from_elites + settings.from_island, dict(settings.scales)
    yield drawn <= 1 + 1e-9, "from_elites and from_island must not exceed 1 together", drawn
    yield settings.crowding > 0, "crowding must be above 0, infinity for none", settings.crowding
    yield (
        0 <= settings.rank_power < math.inf,
        "rank_power must be finite and not negative",
        settings.rank_power,
    )
    kept = settings.elites + settings.islands
    yield (
        settings.population > kept,
        "population must exceed elites plus islands",
        settings.population,
    )
    yield (
        set(scales) == set(SCALES),
        f"scales must name {', '.join(SCALES)}",
        ", ".join(map(str, scales)),
    )
    whole = all(share >= 0 for share in scales.values()) and abs(sum(scales.values()) - 1) < 1e-9
    yield whole, "scales must be shares that add up to 1", scales
