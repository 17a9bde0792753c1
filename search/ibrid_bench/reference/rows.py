"""The rows: what is measured of a reference inverter, each kind by itself, as plain data."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from ibrid_bench.baselines.recovered import recovered
from ibrid_bench.reference.hiding import HIDINGS, GapCase, Hiding, hidden_case, itself
from ibrid_bench.search.hidden import FREQUENCY, exact_model
from ibrid_bench.search.inverters import inverter, plant_of
from ibrid_bench.search.scoring import Rows, Search, made_before, perform
from ibrid_bench.search.trials import rules_trial

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.gap.results.gap import Gap
from ibrid.gap.workflow import find_gap
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.reference import P1_Q03, ReferenceInverter
from ibrid.plants.sweeping import injected_admittance, state_space
from ibrid.structure.diagrams.diagram import Diagram

#: The reference inverters, grid-following first.
INVERTERS = (
    "paper_like",
    "gfl_l_filter",
    "gfl_dc_link",
    "gfm_droop",
    "gfm_vsm",
    "gfm_dvoc",
    "hybrid_gfl_gfm",
    "parallel_gfl_gfm",
)
#: Kinds of rows, in the order in which they are measured.
TASKS = ("sweeps", "fit", "gap", "search", "nearest", "second")
#: Searches that begin with a textbook program: that which fits best, second best.
FROM_TEXTBOOK = ("nearest", "second")
#: All searches; the budget is part of them.
SEARCHES = ("search", *FROM_TEXTBOOK)
#: Two devices behind one PCC, whose textbook program is no start for one.
TWO_DEVICES = "parallel_gfl_gfm"

Row = dict[str, Any]
FindGap = Callable[..., Gap]


@dataclass(frozen=True)
class Effort:
    """How searches are made: in `folder`/KEY, with `budget` evaluations, in this process.

    `search`, `find_gap` : or what stands for them in tests. `ledger` : of searches that need not be
    made again.
    """

    search: Search
    folder: Path
    budget: int
    find_gap: FindGap = find_gap
    ledger: Rows = field(default_factory=dict)


@dataclass(frozen=True)
class Task:
    """A row to measure. `task` : of `TASKS`. `hiding` : of a gap, what is hidden; None: nothing."""

    inverter: str
    task: str
    budget: int
    hiding: Hiding | None = None

    @property
    def key(self) -> str:
        """Names the row in the ledger, and the folder of a search; a search's budget is part of
        it.
        """
        if self.task in SEARCHES:
            return f"{self.inverter}-{self.task}-{self.budget}"
        hidden = (
            ""
            if self.task != "gap"
            else f"-{'nothing' if self.hiding is None else self.hiding.words}"
        )
        return f"{self.inverter}-{self.task}{hidden}".replace(" ", "_")


def tasks(inverters: Sequence[str], kinds: Sequence[str], budget: int) -> Iterator[Task]:
    """All rows, kind by kind."""
    for kind in kinds:
        for name in inverters:
            yield Task(name, kind, budget)
            if kind == "gap":
                yield from (
                    Task(name, kind, budget, one) for one in HIDINGS if one.inverter == name
                )


def measured(task: Task, effort: Effort) -> Row:
    """The row, measured now; IbridError where there is none.

    `seconds` : of CPU time, so that other jobs do not count; of a search, of its run.
    """
    began = time.process_time()
    row = _MEASURE[task.task](task, effort)
    seconds = round(time.process_time() - began, 2)
    return {
        "key": task.key,
        "inverter": task.inverter,
        "task": task.task,
        "seconds": seconds,
        **row,
    }


def _sweeps(task: Task, effort: Effort) -> Row:
    """Largest relative differences over frequencies and operating points, of the norms of 2x2
    matrices.

    `injected` : of the sweep by injection into the nonlinear simulation from its linearisation, at
    the points of the shipped sweep. `program` : of the textbook program with true parameters from
    the linearisation, the held-out point too.
    """
    plant, hidden = _plant(task.inverter), inverter(task.inverter)
    held = () if hidden.held_out is None else tuple(one.op for one in hidden.held_out.points)
    points = (*P1_Q03, *held)
    model = exact_model(hidden.program, hidden.values or {}, points, plant.f0_hz, plant.power_node)
    return {
        "states": len(plant.dynamics.states),
        "injected": max(
            _difference(injected_admittance(plant, op, FREQUENCY), plant, op) for op in P1_Q03
        ),
        "program": max(_difference(model.response(op.name, FREQUENCY), plant, op) for op in points),
    }


def _difference(found: np.ndarray, plant: ReferenceInverter, op: OperatingPoint) -> float:
    exact = state_space(plant, op).admittance(FREQUENCY)
    return float(
        (np.linalg.norm(found - exact, axis=(1, 2)) / np.linalg.norm(exact, axis=(1, 2))).max()
    )


def _fit(task: Task, effort: Effort) -> Row:
    """The textbook program fitted from default starts.

    `recovered` : true parameters within 5 %, `of` so many.
    """
    hidden = inverter(task.inverter)
    truth = hidden.truth
    if truth is None or hidden.held_out is None:
        raise IbridError(
            f"{task.inverter} has no known truth; choose one of {', '.join(INVERTERS)}"
        )
    together = replace(hidden.sweep, points=(*hidden.sweep.points, *hidden.held_out.points))
    record = evaluate(truth, together, holdout_op=hidden.held_out.names)
    return {
        "nrmse": record.nrmse,
        "holdout": max(record.holdout.values()),
        "stable": all(record.stable.values()),
        "recovered": len(recovered(record, truth, hidden.values or {})),
        "of": len(hidden.values or {}),
    }


def _gap(task: Task, effort: Effort) -> Row:
    """`first` : the hidden effect is named first, None where nothing is hidden. `named` : ids, the
    class of the first.

    `right` : the verdict is no-gap where nothing is hidden, and the hidden effect is named, and
    alone, where it is.
    """
    case = itself(task.inverter) if task.hiding is None else hidden_case(task.hiding)
    gap = _answer(case, effort)
    hidden = None if task.hiding is None else task.hiding.effect
    named = [one.id for one in gap.effects]
    first = None if hidden is None else bool(named) and named[0] == hidden
    return {
        "words": "nothing" if task.hiding is None else task.hiding.words,
        "hidden": hidden,
        "verdict": gap.verdict,
        "named": named,
        "alike": list(gap.effects[0].indistinguishable_from) if gap.effects else [],
        "first": first,
        "right": gap.verdict == "no-gap"
        if hidden is None
        else gap.verdict == "named" and bool(first) and len(named) == 1,
        "before": gap.before["refit"],
        "after": gap.after["refit"],
        "holdout": gap.after["holdout"],
        "sentence": gap.sentence,
    }


def _answer(case: GapCase, effort: Effort) -> Gap:
    return effort.find_gap(case.model, case.sweep, case.values or None, holdout_op=(case.held_out,))


def _search(task: Task, effort: Effort) -> Row:
    """From the naive diagram; see `ibrid_bench.search.scoring.score`."""
    trial = rules_trial(task.inverter, effort.budget)
    row = made_before(
        trial, effort.ledger, effort.folder / task.key, search=effort.search, workers=1
    )
    return _of_search(row, effort)


def _from_textbook(task: Task, effort: Effort) -> Row:
    """From the textbook program of another inverter.

    `start` : that inverter, `start_nrmse` : its program fitted.
    """
    start = nearest_textbooks(task.inverter)[FROM_TEXTBOOK.index(task.task)]
    trial, folder = rules_trial(task.inverter, effort.budget), effort.folder / task.key
    row = perform(trial, folder, search=effort.search, workers=1, start=start.program)
    return _of_search(row, effort) | {"start": start.inverter, "start_nrmse": start.nrmse}


def _of_search(row: Row, effort: Effort) -> Row:
    names = (
        "answer_nrmse",
        "holdout",
        "modules_f1",
        "connections_f1",
        "evaluations",
        "first",
        "success",
        "seconds",
    )
    return {name: row[name] for name in (*names, "free_parameters", "answer_program")} | {
        "budget": effort.budget
    }


@dataclass(frozen=True)
class Start:
    """The textbook program of an inverter, and how well it fits the sweep of another."""

    inverter: str
    program: Diagram
    nrmse: float


def nearest_textbooks(name: str) -> list[Start]:
    """The textbook programs, of one device, of the other reference inverters that can be fitted to
    the sweep, best first.
    """
    sweep = inverter(name).sweep
    found = []
    for other in INVERTERS:
        program = inverter(other).truth
        if other in (name, TWO_DEVICES) or program is None:
            continue
        error = evaluate(program, sweep).nrmse
        if error is not None:
            found.append(Start(other, program, error))
    return sorted(found, key=lambda one: one.nrmse)


def _plant(name: str) -> ReferenceInverter:
    plant = plant_of(name)
    if plant is None:
        raise IbridError(f"{name} has no nonlinear model; choose one of {', '.join(INVERTERS)}")
    return plant


_MEASURE: Mapping[str, Callable[[Task, Effort], Row]] = MappingProxyType(
    {
        "sweeps": _sweeps,
        "fit": _fit,
        "gap": _gap,
        "search": _search,
        **dict.fromkeys(FROM_TEXTBOOK, _from_textbook),
    }
)
