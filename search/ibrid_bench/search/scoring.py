"""One search of the benchmark made, and its answer scored against what was hidden and by data it
never saw.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from math import log
from pathlib import Path
from typing import Any, Protocol

from ibrid_bench.search.hidden import Hidden
from ibrid_bench.search.trials import Trial
from ibrid_search.selection.rivals import open_structures
from ibrid_search.settings import SearchSettings

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.measurement.sweeps.sweep import Sweep, measured_numbers
from ibrid.structure.comparison.compare import compare
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program

#: NRMSE that counts as reached: the paper's own result, and the contract's for the exact
#: equilibrium.
PAPER_ERROR, EXACT_ERROR = 0.0435, 1e-3
#: Evaluations and seconds within which the paper's error must be reached.
PAPER_EVALUATIONS, PAPER_SECONDS = 500, 600.0
#: NRMSE of an answer on noisy data over that of the refitted truth that still counts as the noise
#: floor.
NOISE_MARGIN = 1.1
#: F1 of modules and of connections from which on the structure counts as found.
FOUND = 0.9
#: Seed of the independent fits of answer and truth.
CHECKING_SEED = 1000

Row = dict[str, Any]
#: Rows by their keys, as in a ledger.
Rows = Mapping[str, Mapping[str, Any]]


class Answer(Protocol):
    """What is read from a `Run`.

    `trajectory` : (evaluation, nrmse, best so far); the start is 0. `finished` : False when the
    keyboard stopped it.
    """

    @property
    def best(self) -> Record | None: ...
    @property
    def evaluations(self) -> int: ...
    @property
    def seconds(self) -> float: ...
    @property
    def trajectory(self) -> Sequence[tuple[int, float | None, float | None]]: ...
    @property
    def answer_program(self) -> str: ...
    @property
    def finished(self) -> bool: ...
    @property
    def selection(self) -> Mapping[str, Any]: ...


#: `ibrid.search`, or what stands for it in tests: (sweep, folder, options) -> answer.
Search = Callable[..., Answer]


def perform(
    trial: Trial, folder: Path, *, search: Search, workers: int, start: Diagram | None = None
) -> Row:
    """Make the search in `folder` and score its answer; the row is plain data. It never sees the
    held-out point.

    start : None for what the trial says.
    """
    hidden = trial.hidden()
    if start is None and trial.start is not None:
        start = textbook(trial.start)
    began = time.process_time()
    run = search(
        hidden.sweep,
        folder,
        proposer=trial.proposer,
        budget=trial.budget,
        seed=trial.seed,
        workers=workers,
        holdout_op=(),
        start=start,
        settings=SearchSettings(devices=trial.devices),
        **trial.mode,
    )
    if not run.finished:  # the first Ctrl-C ends a search softly, but a part of one is no result
        raise KeyboardInterrupt
    took = {
        "workers": workers,
        "processor_seconds": round(time.process_time() - began, 3) if workers == 1 else None,
    }
    row = {
        "key": trial.key,
        **asdict(trial),
        "data": trial.data,
        **took,
        **score(trial, hidden, run),
    }
    return row | {"rival_f1": _best_listed(trial.truth(hidden), run, folder)}


def made_before(trial: Trial, ledger: Rows, folder: Path, *, search: Search, workers: int) -> Row:
    """The row of a search from the ledger of `make bench-search`, which may hold it; else see
    `perform`.
    """
    return (
        dict(ledger[trial.key])
        if trial.key in ledger
        else perform(trial, folder, search=search, workers=workers)
    )


def score(trial: Trial, hidden: Hidden, run: Answer) -> Row:
    """Numbers of an answer.

    `nrmse` : lowest of a stable candidate in the search. `answer_nrmse`, `holdout` : of the program
    that the search answers with, fitted anew and predicted at the operating point that it never
    saw. `truth_nrmse` : of the true diagram fitted to the same data, `bic_over_truth` : see
    `bic_over`. `first` : evaluation at which the error that the table asks for was reached.
    `success` : see `succeeded`; None where there is no truth.
    """
    if run.best is None:
        raise IbridError(f"{trial.key}: the search found no valid candidate")
    found, truth = parse_program(run.answer_program, "the answer"), trial.truth(hidden)
    answer = fitted(trial, hidden, found)
    reference = None if truth is None else fitted(trial, hidden, truth)
    overlap = None if truth is None else compare(found, truth)
    row: Row = {
        "nrmse": run.best.nrmse,
        "evaluations": run.evaluations,
        "seconds": round(run.seconds, 3),
        "answer_nrmse": answer.nrmse,
        "answer_stable": bool(answer.stable) and all(answer.stable.values()),
        "truth_nrmse": None if reference is None else reference.nrmse,
        "bic_over_truth": None if reference is None else bic_over(answer, reference, hidden.sweep),
        "noise_floor": answer.noise_floor,
        "holdout": max(answer.holdout.values(), default=None),
        "modules_f1": None if overlap is None else overlap.modules.f1,
        "connections_f1": None if overlap is None else overlap.connections.f1,
        "order": answer.order,
        "free_parameters": answer.free_parameters,
        "answer_program": run.answer_program,
    }
    row["first"] = first_at(run.trajectory, limit_of(trial, row))
    row["success"] = None if truth is None else succeeded(trial, row)
    return row


def _best_listed(truth: Diagram | None, run: Answer, folder: Path) -> float | None:
    """The best F1, of modules or connections the lower one, among the rivals that an answer is
    listed with.
    """
    if truth is None or not run.selection.get("rivals"):
        return None
    _, (_, *rivals) = open_structures(folder)
    overlaps = [compare(rival.diagram, truth) for rival in rivals]
    return max(min(one.modules.f1, one.connections.f1) for one in overlaps)


def finding(row: Mapping[str, Any]) -> str:
    """What a search comes to, in a word: "yes", "no", or "-" without a truth.

    Where the truth is not found the data may not decide: it is "listed" among the rivals of the
    answer, or the answer is "preferred", since the Bayesian information criterion speaks for the
    truth by odds of no more than `EQUALLY_GOOD.odds`.
    """
    if row["success"] is None:
        return "-"
    if row["success"]:
        return "yes"
    if (row.get("rival_f1") or 0.0) >= FOUND:
        return "listed"
    bic = row.get("bic_over_truth")
    return "preferred" if bic is not None and bic <= 2 * log(EQUALLY_GOOD.odds) else "no"


def fitted(trial: Trial, hidden: Hidden, diagram: Diagram) -> Record:
    """A diagram fitted to the trial's data with the usual effort, and predicted at the held-out
    point where the mode can.
    """
    held = hidden.held_out
    if held is None or trial.table == "paper":
        return evaluate(diagram, hidden.sweep, seed=CHECKING_SEED, **trial.mode)
    together = replace(hidden.sweep, points=(*hidden.sweep.points, *held.points))
    return evaluate(diagram, together, seed=CHECKING_SEED, holdout_op=held.names, **trial.mode)


def bic_over(record: Record, other: Record, sweep: Sweep) -> float | None:
    """Bayesian information criterion, chi2 + free numbers x ln(measured ones), of a fit less that
    of another to the same data; negative: the data prefer the first. None where their noise is not
    known.
    """
    if record.over_noise is None or other.over_noise is None:
        return None
    measured = measured_numbers(sweep.points)
    chi2 = measured * (record.over_noise**2 - other.over_noise**2)
    return chi2 + (record.free_parameters - other.free_parameters) * log(measured)


def first_at(
    trajectory: Sequence[tuple[int, float | None, float | None]], limit: float
) -> int | None:
    """Evaluation at which the best so far was at or below a limit; None: never."""
    return next((at for at, _, best in trajectory if best is not None and best <= limit), None)


def limit_of(trial: Trial, row: Row) -> float:
    """The NRMSE that counts as reached; with noise, that of the refitted truth and a margin."""
    if trial.table == "paper":
        return PAPER_ERROR
    if trial.noise_db is not None and row["truth_nrmse"] is not None:
        return NOISE_MARGIN * row["truth_nrmse"]
    return EXACT_ERROR


def succeeded(trial: Trial, row: Row) -> bool:
    """In the paper's table its error in time.

    Else the error, reached by a stable answer of the true structure.
    """
    if trial.table == "paper":
        in_time = row["seconds"] <= PAPER_SECONDS
        return row["first"] is not None and row["first"] <= PAPER_EVALUATIONS and in_time
    reached = row["answer_nrmse"] is not None and row["answer_nrmse"] <= limit_of(trial, row)
    return (
        reached and row["answer_stable"] and min(row["modules_f1"], row["connections_f1"]) >= FOUND
    )
