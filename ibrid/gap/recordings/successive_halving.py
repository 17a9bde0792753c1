"""Successive halving (Jamieson & Talwalkar, AISTATS 2016) over candidates on recordings.

Every candidate descends a few steps; those of least misfit go on with more steps.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

if TYPE_CHECKING:
    from ibrid.gap.recordings.event_misfit import EventDescent

Candidate = TypeVar("Candidate")


@dataclass(frozen=True)
class HalvingRung:
    """One rung: the descent of every entrant, and how many go on.

    Parameters
    ----------
    rounds, steps : int
        Rounds of a descent, and Levenberg-Marquardt steps in each.
    survivors : int
        Entrants of least cost that enter the next rung.
    """

    rounds: int
    steps: int
    survivors: int


class Entrant(NamedTuple, Generic[Candidate]):
    """A candidate and its descent, which runs further with every rung."""

    candidate: Candidate
    descent: "EventDescent"


def run_rungs(
    entrants: list[Entrant[Candidate]], rungs: Iterable[HalvingRung]
) -> list[Entrant[Candidate]]:
    """Run the descents rung by rung and return the survivors, least cost first."""
    for rung in rungs:
        for entrant in entrants:
            entrant.descent.run(rung.rounds, rung.steps)
        entrants = rank_entrants(entrants, rung.survivors)
    return entrants


def rank_entrants(entrants: Iterable[Entrant[Candidate]], number: int) -> list[Entrant[Candidate]]:
    """Return that many entrants of least cost, best first; those that diverged drop out."""
    simulated = [entrant for entrant in entrants if np.isfinite(entrant.descent.cost)]
    return sorted(simulated, key=lambda entrant: entrant.descent.cost)[:number]
