"""Every number of a search, with the paper's values where it gives them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType


@dataclass(frozen=True)
class SearchSettings:
    """How a run samples, admits, evaluates and ends.

    Archive (paper, section V.A): `population` : most candidates kept. `islands` : in a ring. `elites` : highest rewards
    over all islands. `from_elites`, `from_island` : share of parents from the elites and from the active island; the
    rest from everything. `sweep` : admissions between migrations. `migrants` : share of an island that its neighbours get to
    see. `rank_power`, `crowding` : parents are drawn with probability rank^-rank_power / (1 + children / crowding) among
    elites and within islands; 0 and infinity for all alike. `front` : share of the draws from the elites that are made
    along the front of error against free parameters, its `front_size` entries of least error.
    `parsimony` : what a free number must gain in ln(NRMSE), per operating point that has its own, to keep its rank.
    `layer` : what a missing control layer (synchronisation, inner loop, outer loops) costs a parent's rank, in ln(NRMSE).
    `bound`, `residual` : the same for a parameter at the end of its box and for a residual module (notch, Pade).

    Edits: `scales` : probability of local, module and structural. `pruning` : share of the steps that try to take
    something away from the best. `history` : best candidates and last failures that a proposer sees.

    Loop: `window` : proposal k sees the results up to k - window, so the archive does not depend on the number of workers.
    `final_pruning` : share of the budget kept for taking away at the end what does not pay. `patience` : proposals in
    a row without a new structure that end the search. `settled` : steps for which the best must stay the best before the
    search ends at a noise floor, since a wrong structure may reach it by luck. `lost` : tries of a candidate whose
    workers die. `wall` : seconds after which the process of a candidate is killed.
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
    parsimony: float = 0.05
    layer: float = 3.0
    bound: float = 0.3
    residual: float = 0.3
    scales: Mapping[str, float] = field(
        default_factory=lambda: MappingProxyType({"local": 0.3, "module": 0.4, "structural": 0.3})
    )
    pruning: float = 0.15
    history: int = 0
    window: int = 8
    final_pruning: float = 0.1
    patience: int = 200
    settled: int = 100
    lost: int = 3
    wall: float = 60.0
