"""The questions that a language model is asked: those of searches by rules, early and late, on
several inverters.
"""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from ibrid_bench.search.inverters import inverter
from ibrid_bench.search.trials import PAPER_MODE
from ibrid_search.proposal import Context, Proposal, Proposer
from ibrid_search.proposers.rules import Rules
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store

from ibrid.structure.diagrams.library import textbook_text

#: A grid-following inverter, a grid-forming one, and one with a DC link.
INVERTERS = ("paper_like", "gfm_droop", "gfl_dc_link")
#: Numbers of the questions of a search that are kept: its parent is the naive diagram first, a
#: candidate of some parts then.
PLACES = (1, 24)
#: Evaluations of such a search, and its seed.
BUDGET, SEED = 32, 0
#: The paper's own setting: its vocabulary makes the shortest questions.
MODE: Mapping[str, Any] = PAPER_MODE


@dataclass(frozen=True, eq=False)
class Question:
    """`place` : of `PLACES`.

    `context` : as the search asked it, with the structures that it had met by then.
    """

    inverter: str
    place: int
    context: Context


class Listener:
    """Keeps the questions that another proposer is asked; see `ibrid_search.proposal.Proposer`."""

    attempts = 1
    window: int | None = None

    def __init__(self, other: Proposer) -> None:
        self.other, self.name = other, other.name
        self.heard: list[Context] = []

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """What the other proposes."""
        self.heard.append(context)
        return self.other.propose(context, rng)


def questions(
    name: str, search: Callable[..., Any], places: Sequence[int] = PLACES
) -> list[Question]:
    """The questions at these places of a search by rules, which is made for it; fewer where the
    search ended before.
    """
    listener = Listener(Rules())
    with tempfile.TemporaryDirectory(prefix="ibrid-questions-") as folder:
        run = Path(folder) / "run"
        search(
            inverter(name).sweep,
            run,
            start=textbook_text("naive"),
            proposer=listener,
            budget=BUDGET,
            seed=SEED,
            **MODE,
        )
        with Store.open(run / ARCHIVE, read_only=True) as store:
            steps = list(store.steps())
    asked = [step.number for step in steps if step.number > 0 and step.proposer == listener.name]
    found = []
    for place, number in [(one, asked[one - 1]) for one in places if one <= len(asked)]:
        met = {step.hash for step in steps[:number] if step.hash}
        found.append(
            Question(name, place, replace(listener.heard[place - 1], seen=met.__contains__))
        )
    return found
