"""A search without fits: results that follow from the structure alone, so that hundreds of steps
take seconds.
"""

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from ibrid_search.edits import edit_between
from ibrid_search.evaluation.job import Job, Result
from ibrid_search.proposal import Context, Evaluated, Proposal, Proposer
from ibrid_search.proposers.rules import Rules
from ibrid_search.recursion.loop import Loop
from ibrid_search.recursion.panel import Panel
from ibrid_search.run.store import Store
from ibrid_search.settings import Goal, SearchSettings
from ibrid_search.step import Status, Step
from sharing import shared

import ibrid
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import find_kind
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.study import Study

NAIVE = ibrid.program_text(ibrid.textbook("naive"))
#: Little effort: these tests are about the search, not about the fit.
QUICK = FitSettings(starts=8, kept=1, kept_misfit=1, restarts=0, hops=0)
#: No step is spent on taking away, so that what the proposer says is what happens.
PLAIN = SearchSettings(pruning=0.0, final_pruning=0.0)

Verdict = Status | float
Law = Callable[[str], Verdict]


@shared
def study() -> Study:
    """The benchmark in its default setting."""
    return Study(ibrid.read_sweep(ibrid.benchmarks()["paper_like"]))


def noisy() -> Sweep:
    """The benchmark with noise of 1 % that it tells."""
    return add_noise(study().sweep, 40, rng=np.random.default_rng(0))


@shared
def naive_record() -> Record:
    """The naive diagram fitted."""
    return ibrid.evaluate(ibrid.textbook("naive"), study().sweep, settings=QUICK)


def record_of(program: str, **changes: Any) -> Record:
    """A record of a program with the naive one's numbers, but for changes; enough for proposers to
    read.
    """
    kinds = [find_kind(one.kind, study().kinds) for one in ibrid.parse_program(program).instances]
    size = {
        "order": sum(kind.order for kind in kinds),
        "free_parameters": sum(len(kind.parameters) for kind in kinds),
    }
    made = replace(naive_record(), program=program, modules=len(kinds), **size)
    return replace(made, **changes)


def context_of(diagram: ibrid.Diagram, *, record: Record | None = None, **changes: Any) -> Context:
    """The question about how to edit a diagram, the only structure that was met."""
    found = record or record_of(ibrid.program_text(diagram))
    asked = {"study": study(), "parent": Evaluated(0, diagram, found), **changes}
    met = asked["study"].hash_of(diagram)
    return Context(**{"seen": lambda structure: structure == met, **asked})


def luck(program: str) -> float:
    """A number from 0 to 1 that belongs to the structure."""
    found = structure_hash(ibrid.parse_program(program), study().kinds)
    return int(hashlib.sha256(found.encode()).hexdigest()[:8], 16) / 16**8


def by_luck(program: str) -> Verdict:
    """An error that falls with the number of modules, luck aside; one structure in eight has no
    fit.
    """
    chance = luck(program)
    if chance < 1 / 8 and program != NAIVE:
        return Status.FAILED
    return math.exp(-0.1 * len(ibrid.parse_program(program).instances)) * (0.5 + chance)


def luckily_stable(program: str) -> bool:
    """False for one structure in six, among those with a fit."""
    return luck(program) < 5 / 6


class ScriptedProposer:
    """A proposer that remembers what it was asked, and answers by a function of the context and its
    number.
    """

    name = "scripted"

    def __init__(
        self,
        answer: Callable[[Context, int], Proposal],
        attempts: int = 1,
        window: int | None = None,
    ) -> None:
        self.answer, self.attempts, self.window = answer, attempts, window
        self.asked: list[Context] = []

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        self.asked.append(context)
        return self.answer(context, len(self.asked))


def fixed(number: int) -> str:
    """The naive program with another fixed gain: a structure of its own for every number."""
    return NAIVE.replace('"gain")', f'"gain", k={number / 1000})')


def numbered(context: Context, number: int) -> Proposal:
    """A new structure every time."""
    return Proposal(
        edit_between(context.parent.record.program, fixed(number)), note=f"gain {number}"
    )


class ScriptedEvaluator:
    """Answers by a law of the program, one job after the other when asked for; remembers what it
    was given.

    misfit : of a record with this NRMSE, for data with a known noise.
    """

    capacity = 1

    def __init__(
        self,
        law: Law = by_luck,
        stable: Callable[[str], bool] = luckily_stable,
        misfit: Callable[[float], float | None] = lambda _: None,
    ) -> None:
        self.law, self.stable, self.misfit = law, stable, misfit
        self.open: dict[int, Job] = {}
        self.jobs: list[Job] = []
        self.collected: list[int] = []

    def submit(self, job: Job) -> None:
        if job.number in self.open:
            raise IbridError(f"two jobs must not have the number {job.number}")
        self.open[job.number] = job
        self.jobs.append(job)

    def first_ended(self) -> int:
        return next(iter(self.open))

    def collect(self, number: int) -> Result:
        job = self.open.pop(number)
        self.collected.append(number)
        found = self.law(job.program)
        if isinstance(found, Status):
            return Result(number, found, None, f"the law says {found}", 0.0, 1)
        stable = dict.fromkeys(naive_record().stable, self.stable(job.program))
        numbers = {"nrmse": found, "over_noise": self.misfit(found), "reward": -math.log(found)}
        record = record_of(job.program, **numbers, stable=stable)
        return Result(number, Status.OK, record, "", 0.0, 1)

    def close(self) -> None:
        self.open.clear()

    def __enter__(self) -> "ScriptedEvaluator":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def scripted(
    path: Path,
    *,
    proposers: Sequence[tuple[Proposer, float]] | None = None,
    budget: int = 30,
    seed: int = 0,
    sweep: Sweep | None = None,
    target: float | None = None,
    settings: SearchSettings | None = None,
    evaluator: ScriptedEvaluator | None = None,
    require: str = "",
    watch: Callable[[Loop, Step], None] = lambda loop, step: None,
) -> Iterator[Loop]:
    """A loop over the store at `path`, new or that of an earlier sitting; `sweep` : in place of the
    clean benchmark.
    """
    settings, data = settings or SearchSettings(), sweep or study().sweep
    store = Store.open(path) if path.exists() else Store.create(path, {"start": NAIVE})
    with store:
        yield Loop(
            replace(study(), sweep=data, seed=seed),
            store,
            evaluator or ScriptedEvaluator(),
            Panel(proposers or ((Rules(looks=1), 1.0),)),
            settings,
            Goal(budget, target, require=require),
            watch=watch,
        )


def steps_of(path: Path) -> list[Step]:
    """What a store holds, but for the time it took."""
    with Store.open(path, read_only=True) as store:
        return [replace(step, seconds=0.0) for step in store.steps()]


def ended(path: Path, **options: Any) -> tuple[str, Loop]:
    """A whole search from the naive program, and why it ended; options as of `scripted`."""
    with scripted(path, **options) as loop:
        return loop.run(NAIVE), loop
