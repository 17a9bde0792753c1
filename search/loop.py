"""The recursion: draw a parent, ask a proposer, judge the edit, evaluate, admit; in a fixed order, resumable anywhere.

Proposal k is made from the results of the steps up to k - window and from random numbers that follow from the seed and k
alone. So the archive is the same with any number of workers, and a run that was killed goes on as if it had not been.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.structure.program import parse_program
from search.archive import Archive, Entry
from search.evaluation.job import Evaluator, Job, Result
from search.judging import judge, judge_program
from search.merit import Criterion
from search.proposal import SCALES, Complaint, Context, Evaluated, Proposer, Task
from search.proposers.pruning import Pruning
from search.requirements import Requirements
from search.roles import roles
from search.settings import SearchSettings
from search.step import EVALUATED, Status, Step
from search.store import Store
from search.trajectory import eligible

#: Sentences about how a search ended.
BUDGET, TARGET, FLOOR = "the budget is spent", "the target is reached", "the noise floor is reached"
NOTHING_NEW, STOPPED = "no proposal led to a new structure for a long time", "stopped by the keyboard"


@dataclass(frozen=True)
class Limits:
    """When to end. `budget` : evaluations, the start included. `target` : NRMSE that is enough; None: the noise floor."""

    budget: int
    target: float | None = None


class Loop:
    """One search over a store: `run` makes steps until an end is reached; made anew over an old store it goes on."""

    def __init__(
        self,
        task: Task,
        store: Store,
        evaluator: Evaluator,
        proposers: Sequence[tuple[Proposer, float]],
        settings: SearchSettings,
        limits: Limits,
        *,
        seed: int,
        criterion: Criterion,
        requirements: Requirements,
        watch: Callable[["Loop", Step], None] = lambda loop, step: None,
    ) -> None:
        self.task, self.store, self.evaluator = task, store, evaluator
        self.proposers, self.settings, self.limits, self.seed = tuple(proposers), settings, limits, seed
        self.criterion, self.requirements, self.watch = criterion, requirements, watch
        self.pruning = Pruning()
        self.window = min([settings.window, *(one.window for one, _ in self.proposers if one.window is not None)])
        self.archive = Archive(settings)
        self.steps: list[Step] = []
        self.known: dict[str, int] = {}
        self.absorbed = 0
        self.evaluations = 0
        self.best: Step | None = None
        self.idle = 0
        self.stop_asked = False
        self._records: dict[int, Record] = {}
        self._least: list[float | None] = []  # of every absorbed step: the best NRMSE known then

    # --- the course --------------------------------------------------------------------------------------------------

    def run(self, start: str) -> str:
        """Go on from what the store holds, or from the program `start`; returns how the search ended."""
        self._restore()
        if not self.steps:
            self._append(self._first(start))
        ending = None
        while ending is None:
            self._absorb(max(len(self.steps) - self.window, 0))
            self._require_a_start()
            ending = self._ending()
            if ending is None:
                ending = self._step()
        self._absorb(len(self.steps) - 1)
        return ending

    def _step(self) -> str | None:
        """Make a step; an ending instead when the last part has nothing left to take away."""
        step = self._proposed(len(self.steps))
        if self._tidying and step.status is Status.NO_ANSWER:
            if self.absorbed == len(self.steps):
                return self._reached or BUDGET
            self._absorb(len(self.steps) - 1)  # a result under way may change what there is to take away
            return None
        self._append(step)
        return None

    def _ending(self) -> str | None:
        if self.stop_asked:
            return STOPPED
        if self.evaluations >= self.limits.budget:
            return BUDGET
        return NOTHING_NEW if self.idle >= self.settings.patience else None

    @property
    def _reached(self) -> str | None:
        """TARGET or FLOOR when the best step is good enough."""
        if self.best is None or self.best.nrmse is None:
            return None
        if self.limits.target is not None and self.best.nrmse <= self.limits.target:
            return TARGET
        return FLOOR if self.criterion.floor.reached(self.best.nrmse) else None

    @property
    def _tidying(self) -> bool:
        """True in the last part, in which things are only taken away from the best."""
        kept = int(self.settings.final_pruning * self.limits.budget)
        return self._reached is not None or self.evaluations >= self.limits.budget - kept

    def _require_a_start(self) -> None:
        first = self.steps[0]
        if first.status is not Status.OK:
            raise IbridError(
                f"the start must have a fit, found {first.status}: {first.reason}; give another one with --start"
            )

    def _restore(self) -> None:
        """Take over the steps of the store; those that wait for their evaluation are handed over again."""
        for step in self.store.steps():
            self.steps.append(step)
            self._remember(step)
        for step in self.steps:
            if step.status is Status.PENDING:
                known = self.criterion.best(self.steps[: max(step.number - self.window + 1, 0)])
                self._submit(step, None if known is None else known.nrmse)

    def _append(self, step: Step) -> None:
        self.store.propose(step)
        self.steps.append(step)
        self._remember(step)
        if step.status is Status.PENDING:
            before = step.number - self.window
            self._submit(step, self._least[before] if before >= 0 else None)

    def _remember(self, step: Step) -> None:
        fresh = step.status in EVALUATED or step.status is Status.PENDING
        self.idle = 0 if fresh else self.idle + 1
        self.evaluations += fresh
        if step.hash and fresh:
            self.known.setdefault(step.hash, step.number)

    # --- proposing ---------------------------------------------------------------------------------------------------

    def _first(self, start: str) -> Step:
        verdict = judge_program(start, self.task)
        if verdict.status is not Status.PENDING:
            raise IbridError(f"the start must be a legal diagram: {verdict.reason}")
        return Step(number=0, note="the start", hash=verdict.hash, program=verdict.program)

    def _proposed(self, number: int) -> Step:
        """The next step: parent, scale and proposer are drawn, the proposer is asked, its edit is judged."""
        rng = np.random.default_rng([self.seed, number])
        parent, island, proposer, scale = self._drawn(rng, number)
        context = self._context(parent, scale)
        for attempt in range(proposer.attempts):
            proposal = proposer.propose(context, rng)
            verdict = judge(proposal, parent.program, parent.hash, self.task, self.known.get)
            if verdict.status not in _WORTH_ANOTHER_TRY or attempt + 1 == proposer.attempts:
                break
            context = replace(context, complaint=Complaint(proposal.edit, verdict.reason))
        return Step(
            number=number,
            parent=parent.step,
            island=island,
            scale=scale,
            proposer=proposer.name,
            note=proposal.note,
            edit=proposal.edit,
            reply=proposal.reply,
            diagnosis=proposal.diagnosis,
            usage=proposal.usage,
            status=verdict.status,
            reason=verdict.reason,
            hash=verdict.hash,
            same_as=verdict.same_as,
            program=verdict.program,
        )

    def _drawn(self, rng: np.random.Generator, number: int) -> tuple[Entry, int, Proposer, str]:
        scale = str(rng.choice(SCALES, p=[self.settings.scales[one] for one in SCALES]))
        weights = np.array([weight for _, weight in self.proposers])
        proposer = self.proposers[int(rng.choice(len(weights), p=weights / weights.sum()))][0]
        parent, island = self.archive.sample(rng, number)
        if self.best is not None and (self._tidying or rng.random() < self.settings.pruning):
            chosen = self.best if self._tidying else self.steps[self.archive.best.step]  # type: ignore[union-attr]
            return self._entry(chosen), chosen.island, self.pruning, "module"
        return parent, island, proposer, scale

    def _context(self, parent: Entry, scale: str) -> Context:
        history = self.settings.history
        best = [one for one in self.archive.elites[: history + 1] if one.step != parent.step][:history]
        return Context(
            task=self.task,
            parent=self._evaluated(parent),
            scale=scale,
            best=tuple(self._evaluated(one) for one in best),
            failures=self._failures(history),
            last=self.steps[self.absorbed - 1] if self.absorbed > 1 else None,
            seen=self.known.__contains__,
        )

    def _failures(self, number: int) -> tuple[Step, ...]:
        refused = (one for one in reversed(self.steps[: self.absorbed]) if one.status in _INSTRUCTIVE)
        return tuple(step for step, _ in zip(refused, range(number), strict=False))

    def _evaluated(self, entry: Entry) -> Evaluated:
        record = self.record(entry.step)
        return Evaluated(entry.step, parse_program(entry.program), record)

    def record(self, number: int) -> Record:
        """The record of a step, read from the store."""
        if number not in self._records:
            if len(self._records) > 256:
                self._records.clear()
            self._records[number] = self.store.record(number, self.task.kinds)
        return self._records[number]

    # --- evaluating and admitting ------------------------------------------------------------------------------------

    def _submit(self, step: Step, promising: float | None) -> None:
        warm = self.record(step.parent).parameters if step.parent is not None else None
        self.evaluator.submit(Job(step.number, step.program, warm, promising))

    def _absorb(self, until: int) -> None:
        """Wait for the results of the steps up to `until`, store them, and admit them in their order."""
        while self.absorbed <= until:
            step = self.steps[self.absorbed]
            if step.status is Status.PENDING:
                self._conclude(self.evaluator.collect(step.number))
                step = self.steps[self.absorbed]
            self._admit(step)
            self._least.append(None if self.best is None else self.best.nrmse)
            self.absorbed += 1
            self.watch(self, step)

    def _conclude(self, result: Result) -> None:
        status, reason, record = result.outcome, result.reason, result.record
        if status is Status.OK and record is not None and (complaint := self.requirements.unmet(record)):
            status, reason = Status.REQUIRED, complaint
        self.store.conclude(
            result.number,
            status=status,
            reason=reason,
            record=record,
            seconds=result.seconds,
            attempts=result.attempts,
        )
        self.steps[result.number] = self.store.step(result.number)

    def _admit(self, step: Step) -> None:
        if step.status is not Status.OK:
            return
        entry = self._entry(step)
        if step.number == 0:
            self.archive.admit_start(entry)
        else:
            self.archive.admit(entry)
        if eligible(step):
            self.best = self.criterion.best([step] if self.best is None else [self.best, step])

    def _entry(self, step: Step) -> Entry:
        nrmse, free = float(step.nrmse or 0.0), int(step.free or 0)
        found = roles(parse_program(step.program), self.task.kinds)
        missing = 0 if found is None else found.missing_layers
        return Entry(
            step=step.number,
            hash=step.hash,
            parent=step.parent,
            island=step.island,
            reward=self.criterion.merit(nrmse, free, missing),
            nrmse=nrmse,
            order=int(step.order or 0),
            free=free,
            stable=bool(step.stable),
            program=step.program,
        )


#: An attempt that ended so may be repeated with the complaint.
_WORTH_ANOTHER_TRY = (
    Status.NO_EDIT, Status.NO_MATCH, Status.AMBIGUOUS, Status.UNREADABLE, Status.ILLEGAL, Status.IMPLAUSIBLE,
)  # fmt: skip
#: What a proposer can learn from.
_INSTRUCTIVE = (*_WORTH_ANOTHER_TRY, Status.UNCHANGED, Status.DUPLICATE, Status.FAILED, Status.REQUIRED)
