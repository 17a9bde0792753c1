"""The contract of proposers, for their authors: `ibrid.testing.check_proposer`."""

import copy
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.read import read_sweep
from ibrid.modules.contract import require_no_complaints
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.study import Study
from ibrid_search.edits import apply_edit
from ibrid_search.evaluated import SCALES, Evaluated
from ibrid_search.proposal import Complaint, Context, Proposal, Proposer
from ibrid_search.step import Status, Step

#: A proposer is asked on this many seeds.
SEEDS = range(5)


@takes_kinds
def check_proposer(make: Callable[[], Any], diagrams: Sequence[Diagram] = ()) -> None:
    """Check that a proposer answers as a search needs it.

    Asked about given parents, by default the naive and a textbook diagram fitted to the benchmark,
    also with failures and a complaint behind it, it answers a `Proposal` and raises nothing; the
    same `rng` gets the same answer; an edit applies to the parent's program and gives one that
    reads; no edit says why.

    Parameters
    ----------
    make : makes the proposer anew, such as its class. diagrams : parents that it is asked about.

    Raises
    ------
    AssertionError : a list of what to mend.
    """
    proposer = make()
    name = getattr(proposer, "name", type(proposer).__name__)
    if not isinstance(proposer, Proposer):
        require_no_complaints(
            f"the proposer {name}",
            ["it must have name, attempts, window and propose(context, rng)"],
        )
    complaints = []
    if not (isinstance(proposer.name, str) and proposer.name.strip()):
        complaints.append(f"name must be a word, found {proposer.name!r}; runs and pages show it")
    if not (isinstance(proposer.attempts, int) and proposer.attempts >= 1):
        complaints.append(f"attempts must be 1 or more, found {proposer.attempts!r}")
    if not (proposer.window is None or (isinstance(proposer.window, int) and proposer.window >= 1)):
        complaints.append(f"window must be None or 1 or more, found {proposer.window!r}")
    for context in _contexts(tuple(diagrams) or (textbook("naive"), textbook("gfl"))):
        for seed in SEEDS:
            complaints += _of_answer(make, context, seed)
    require_no_complaints(f"the proposer {name}", complaints)


def _contexts(diagrams: Sequence[Diagram]) -> Iterator[Context]:
    study = Study(read_sweep(benchmarks()["paper_like"]))
    for diagram in diagrams:
        parent = Evaluated(0, diagram, evaluate(diagram, study, restarts=0))
        failed = Step(
            1, 0, status=Status.FAILED, reason="no fit exists", program=program_text(diagram)
        )
        yield from (Context(study, parent, scale) for scale in SCALES)
        yield Context(study, parent, best=(parent,), failures=(failed,), last=failed)
        yield Context(study, parent, complaint=Complaint("", "no edit found"))


def _of_answer(make: Callable[[], Any], context: Context, seed: int) -> Iterator[str]:
    where = f"asked for a {context.scale} edit of {context.parent.diagram.name}"
    try:
        answer, again = (
            make().propose(copy.copy(context), np.random.default_rng(seed)) for _ in range(2)
        )
    except Exception as error:  # other people's code: anything may go wrong in it
        yield (
            f"{where}: propose must not raise, found {type(error).__name__} ({error}); say it in "
            "Proposal.failure"
        )
        return
    if strange := [type(one).__name__ for one in (answer, again) if not isinstance(one, Proposal)]:
        yield f"{where}: propose must return a Proposal, found {strange[0]}"
        return
    if answer.edit != again.edit:
        yield f"{where}: the same rng must give the same edit, found another; draw from `rng` alone"
    if not answer.edit:
        if not (answer.failure or answer.note or answer.reply).strip():
            yield (
                f"{where}: a proposal without an edit must say why in `failure`, or in `note`, "
                "found nothing"
            )
        return
    try:
        parse_program(apply_edit(answer.edit, program_text(context.parent.diagram)))
    except IbridError as error:
        yield (
            f"{where}: the edit must apply to the parent's program and give one that reads; {error}"
        )
