"""The recursion: draw a parent, ask a proposer, judge the edit, evaluate, admit; in a fixed order,
resumable anywhere.

Proposal k is made from the results of the steps up to k - window and from random numbers that
follow from the seed and k alone. So the archive is the same with any number of workers, and a run
that was killed goes on as if it had not been. With a proposer that learns from evaluations, a whole
batch of its answers is made from the results of the batches before.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from ibrid.errors import IbridError, UnfinishedError
from ibrid.fit.adequacy import BETTER
from ibrid.interrupts import heed_interrupt
from ibrid.structure.diagrams.program import parse_program
from ibrid.study import Study
from ibrid_search.archives.appraisal import Appraisal
from ibrid_search.archives.archive import Archive, Entry
from ibrid_search.chat.spending import added
from ibrid_search.evaluated import SCALES, Evaluated
from ibrid_search.evaluation.job import Evaluator, Job, Result
from ibrid_search.evaluation.judging import Judgement, judge, judge_program
from ibrid_search.proposal import KEPT, Complaint, Context, Proposal, Proposer, answer_of
from ibrid_search.recursion.panel import Panel
from ibrid_search.run.store import Store
from ibrid_search.run.trajectory import eligible
from ibrid_search.screening.candidate_edits import library_hashes
from ibrid_search.screening.selection_criterion import build_criterion
from ibrid_search.settings import Goal, SearchSettings
from ibrid_search.step import EVALUATED, OPEN_AGAIN, REFUSED, USABLE, Status, Step

#: Sentences about how a search ended.
BUDGET, TARGET = "the budget is spent", "the target is reached"
FLOOR, EXACT_FIT = "the noise floor is reached", "the fit is exact"
NOTHING_NEW, STOPPED = (
    "no proposal led to a new structure for a long time",
    "stopped by Ctrl-C, a signal or its live page",
)
#: Last steps that a question may tell.
RECENT = 8
#: How much longer than another a best with something odd about it must stay the best before the
#: search ends.
DOUBTED = 3
SPENT = "the limits of the language models are spent"


@dataclass(eq=False, repr=False)
class Loop:
    """One search over a store: `run` makes steps until an end is reached; made anew over an old
    store it goes on.
    """

    study: Study
    store: Store
    evaluator: Evaluator
    panel: Panel
    settings: SearchSettings
    goal: Goal
    watch: Callable[["Loop", Step], None] = lambda loop, step: None

    def __post_init__(self) -> None:
        study, settings = self.study, self.settings
        published = library_hashes(study) if self.panel.starts else frozenset()
        self.appraisal = Appraisal(
            self.store, build_criterion(study, settings), study.kinds, published
        )
        self.window = self.panel.window(settings.window)
        self.archive = Archive(settings)
        self.steps: list[Step] = []
        self.known: dict[str, int] = {}
        self.absorbed = self.restored = (
            0  # steps whose result is in the archive; steps of an earlier sitting
        )
        self.evaluations = 0
        self.best: Step | None = None
        self.by_data: Step | None = (
            None  # the best, published or not, where data tell their noise: tidied first
        )
        self.idle = 0
        self.bare: set[int] = set()  # steps from which nothing more can be taken away
        self.stop_asked = False  # at the end of what is under way

    # --- the course
    # ------------------------------------------------------------------------------------------

    def run(self, start: str) -> str:
        """Go on from what the store holds, or from the program `start`; returns how the search
        ended.
        """
        self._restore()
        if not self.steps:
            self._append(self._first(start))
        ending = None
        while ending is None:
            self._absorb(self.panel.horizon(len(self.steps) - self.window))
            if (first := self.steps[0]).status not in USABLE:
                error = UnfinishedError if first.status in OPEN_AGAIN else IbridError
                raise error(
                    f"the start must have a fit, found {first.status}: {first.reason}; give "
                    "another one with --start"
                )
            if not self.stop_asked:
                self.panel.learn(self.steps, self._asked_again)
            ending = self._ending() or self._step()
            if ending is None and (why := self.panel.broken):
                self._absorb(len(self.steps) - 1)
                raise IbridError(
                    f"{why}; this answered several questions in a row, so the search ends. {KEPT}"
                )
        self._absorb(len(self.steps) - 1)
        return ending

    def _step(self) -> str | None:
        """Make a step; an ending instead when the best is good enough and has nothing left to take
        away.

        While results are under way that may change this, the fruitless step is kept: what a step
        sees follows from its number alone, also after a resume. A best that is not good enough yet
        leaves the rest of the budget to the search.
        """
        reached = self._reached
        for tidied in (self.by_data, self.best) if self._tidying else ():
            final = tidied is self.best and reached is not None
            if tidied is None or (tidied.number in self.bare and not final):
                continue
            step = self._proposed(tidied)
            if step.status is not Status.NO_ANSWER or (final and self._under_way):
                self._append(step)
                return None
            if final:
                return reached
            self.bare.add(tidied.number)
        self._append(self._proposed())
        return None

    def _ending(self) -> str | None:
        if self.stop_asked:
            return STOPPED
        if self.evaluations >= self.goal.budget:
            return TARGET if self._reached == TARGET else BUDGET
        if self.panel.exhausted and self.best is None and not self._under_way:
            return SPENT
        return NOTHING_NEW if self.idle >= self.settings.patience else None

    @property
    def _reached(self) -> str | None:
        """TARGET, FLOOR or EXACT_FIT when the best step is good enough, SPENT when nobody can be
        asked any more.
        """
        if self.best is None or self.best.nrmse is None:
            return None
        if self.panel.exhausted:  # the answer of one that is tells nothing
            return SPENT
        if self.goal.target is not None and self.best.nrmse <= self.goal.target:
            return TARGET
        if not self._at_floor:
            return None
        known, odd = (
            self.appraisal.criterion.floor.known,
            self.appraisal.issues_of(self.best).total > 0,
        )
        stood = len(self.steps) - max(self.best.number, len(self.panel.starts))
        needed = self.panel.settled(self.settings.settled) * (DOUBTED if odd else known)
        return None if stood < needed else FLOOR if known else EXACT_FIT

    @property
    def _under_way(self) -> bool:
        """True while there are evaluations whose results no proposal has seen."""
        return any(map(_fresh, self.steps[self.absorbed :]))

    @property
    def _at_floor(self) -> bool:
        return self.best is not None and self.appraisal.at_floor(self.best)

    @property
    def _tidying(self) -> bool:
        """True in the last part, in which things are only taken away from the best."""
        kept = int(self.settings.final_pruning * self.goal.budget)
        if self.appraisal.criterion.floor.known and len(self.steps) <= len(self.panel.starts):
            return False  # what explains the data within the noise may be another of the starts
        return (
            self._at_floor
            or self._reached is not None
            or self.evaluations >= self.goal.budget - kept
        )

    def _restore(self) -> None:
        """Take over the steps of the store; those that wait for their evaluation, or have lost it,
        are handed over again.
        """
        for step in self.store.steps():
            if step.status in OPEN_AGAIN:
                self.store.reopen(step.number)
                step = self.store.step(step.number)
            self.steps.append(step)
            self._remember(step)
        self.restored = len(self.steps)
        for step in self.steps:
            if step.status is Status.PENDING:
                self._submit(step)

    def _append(self, step: Step) -> None:
        self.store.propose(step)
        self.steps.append(step)
        self._remember(step)
        if step.status is Status.PENDING:
            self._submit(step)

    def _remember(self, step: Step) -> None:
        fresh = _fresh(step)
        self.idle = 0 if fresh else self.idle + 1
        self.evaluations += fresh
        if step.hash and fresh:
            self.known.setdefault(step.hash, step.number)
        self.panel.note(step)

    # --- proposing
    # ------------------------------------------------------------------------------------------

    def _first(self, start: str) -> Step:
        verdict = judge_program(start, self.study)
        if verdict.status is not Status.PENDING:
            raise IbridError(f"the start must be a legal diagram: {verdict.reason}")
        return Step(number=0, note="the start", hash=verdict.hash, program=verdict.program)

    def _proposed(self, pruned: Step | None = None) -> Step:
        """The next step: parent, scale and proposer are drawn, the proposer is asked, its edit is
        judged.

        pruned : the step from which something is to be taken away, when that is settled.
        """
        number = len(self.steps)
        rng = np.random.default_rng([self.study.seed, number])
        for draw in self._drawn(rng, number, pruned):
            parent, island, proposer, scale = draw
            proposal, edited, verdict = self._asked(
                proposer, self._context(parent, scale), parent, rng
            )
            if proposer is not self.panel.pruning or verdict.status is not Status.NO_ANSWER:
                break  # else there is nothing left to take away, and the step is an ordinary one
        return Step(
            number=number,
            parent=edited.step,
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

    def _drawn(
        self, rng: np.random.Generator, number: int, pruned: Step | None
    ) -> Iterator[tuple[Entry, int, Proposer, str]]:
        """Parent, its child's island, proposer and scale, in the order in which they are tried."""
        scale = str(rng.choice(SCALES, p=[self.settings.scales[one] for one in SCALES]))
        proposer, origin = self.panel.drawn(rng, number)
        best = self.archive.best
        if origin.leading and best is not None:
            parent, island = best, best.island
        elif origin.like is None:
            parent, island = self.archive.sample(rng, origin.turn)
        else:
            like = self.steps[origin.like]
            parent, island, scale = self._parent(like), like.island, like.scale
        if pruned is not None:
            yield self.appraisal.entry(pruned), pruned.island, self.panel.tidying, "module"
            return
        if (
            best is not None
            and proposer is not self.panel.starts
            and rng.random() < self.settings.pruning
        ):
            yield best, best.island, self.panel.pruning, "module"
        yield parent, island, proposer, scale

    def _asked(
        self, proposer: Proposer, context: Context, parent: Entry, rng: np.random.Generator
    ) -> tuple[Proposal, Entry, Judgement]:
        """The proposer's edit, what it edits and what is to be said of it; a further attempt sees
        the complaint about the one before.

        The usage is that of all attempts.
        """
        usage: Mapping[str, Any] = {}
        for _ in range(max(proposer.attempts, 1)):
            proposal = answer_of(proposer, context, rng)
            usage = added(usage, proposal.usage)
            edited = (
                parent
                if proposal.parent is None
                else self.appraisal.entry(self.steps[proposal.parent])
            )
            verdict = judge(proposal, edited.program, edited.hash, self.study, self.known.get)
            if verdict.status not in _WORTH_ANOTHER_TRY:
                break
            context = replace(context, complaint=Complaint(proposal.edit, verdict.reason))
        return replace(proposal, usage=usage), edited, verdict

    def _context(self, parent: Entry, scale: str) -> Context:
        history = self.panel.history(self.settings.history)
        best = [one for one in self.archive.elites[: history + 1] if one.step != parent.step][
            :history
        ]
        refused = (
            one for one in reversed(self.steps[: self.absorbed]) if one.status in _INSTRUCTIVE
        )
        return Context(
            study=self.study,
            parent=self._evaluated(parent),
            scale=scale,
            best=tuple(self._evaluated(one) for one in best),
            failures=tuple(islice(refused, history)),
            last=self.steps[self.absorbed - 1] if self.absorbed > 1 else None,
            recent=tuple(reversed(self.steps[max(self.absorbed - RECENT, 1) : self.absorbed])),
            seen=self.known.__contains__,
            leading=self.archive.best is None or parent.step == self.archive.best.step,
        )

    def _parent(self, step: Step) -> Entry:
        """What a step edits; the start has none, and is never asked."""
        return self.appraisal.entry(self.steps[step.parent or 0])

    def _asked_again(self, step: Step) -> Context:
        """The question that led to a step, without what was known of other candidates."""
        return Context(self.study, self._evaluated(self._parent(step)), step.scale)

    def _evaluated(self, entry: Entry) -> Evaluated:
        return Evaluated(
            entry.step, parse_program(entry.program), self.appraisal.record(entry.step)
        )

    # --- evaluating and admitting
    # ------------------------------------------------------------------------------------------

    def _submit(self, step: Step) -> None:
        if step.parent is None:
            job = Job(step.number, step.program)
        else:
            before, error = self.appraisal.record(step.parent), self.appraisal.error(step.parent)
            job = Job(
                step.number,
                step.program,
                before.parameters,
                BETTER.promising * error,
                before.free_parameters,
            )
        self.evaluator.submit(job)

    def _absorb(self, until: int) -> None:
        """Wait for the results of the steps up to `until`, store them, and admit them in their
        order.
        """
        while self.absorbed <= until:
            while self.steps[self.absorbed].status is Status.PENDING:
                ended = (
                    self.evaluator.first_ended()
                )  # results are stored as they come, whatever their turn
                result = self.evaluator.collect(ended)
                heed_interrupt()  # what was evaluated may have failed for it
                self._conclude(result)
            step = self.steps[self.absorbed]
            self._admit(step)
            self.absorbed += 1
            self.watch(self, step)

    def _conclude(self, result: Result) -> None:
        status, reason, record = result.outcome, result.reason, result.record
        if (
            status is Status.OK
            and record is not None
            and (complaint := self.goal.requirements.unmet(record))
        ):
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
        """Let a valid step into the archive; a start that is not as required is a parent, but no
        elite.
        """
        if step.status is not Status.OK and not (step.number == 0 and step.status in USABLE):
            return
        entry = self.appraisal.entry(step)
        if step.number == 0:
            self.archive.admit_start(
                replace(entry, stable=entry.stable and step.status is Status.OK)
            )
        else:
            self.archive.admit(entry)
        if eligible(step):
            rank = self.appraisal.rank
            self.best = min(filter(None, (self.best, step)), key=rank)
            if self.appraisal.criterion.floor.known:
                self.by_data = min(
                    filter(None, (self.by_data, step)), key=lambda one: rank(one, alike=True)
                )


def _fresh(step: Step) -> bool:
    """True for a step with an evaluation of its own, done or under way."""
    return step.status in EVALUATED or step.status is Status.PENDING


#: An attempt that ended so may be repeated with the complaint.
_WORTH_ANOTHER_TRY = {*REFUSED} - {Status.NO_ANSWER}
#: What a proposer can learn from.
_INSTRUCTIVE = {*Status} - {Status.NO_ANSWER, Status.PENDING, Status.OK, Status.LOST}
