"""A proposer that learns: answers in groups, and after each batch an update from their rewards.
Importing it needs no torch.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from ibrid_search.proposal import Context, Origin, Proposal, TakesPart
from ibrid_search.proposers.first_look import LOOKED_AT
from ibrid_search.run.store import Store
from ibrid_search.step import Step

from ibrid.errors import IbridError
from ibrid.writing import inside
from ibrid_policy.asking import asked
from ibrid_policy.backend import threads
from ibrid_policy.interface import Policy, Sampled
from ibrid_policy.learning.advantages import batch_advantages
from ibrid_policy.learning.checkpoint import CHECKPOINT
from ibrid_policy.learning.given import (
    KEPT,
    GivenQuestion,
    kept,
    kept_answer,
    kept_answers,
    questions,
)
from ibrid_policy.learning.rounds import AnswerPlace, Rounds
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.learning.state import LearningState
from ibrid_policy.learning.updates import Update, counted, mean_of_known

if TYPE_CHECKING:
    from ibrid_policy.learning.trainer import Group

#: Answers that are drawn to prove that the served weights are the trained ones.
PROBES = 4
#: Said of an update that moved the policy by less than serving differs from training.
UNTOLD = "the update is too small for the probe to tell whether the new weights are served"
#: Share of answers with the same structure as one before in their batch above which the page warns,
#: when the entropy has fallen to this share of that of the first update: answers to one question
#: repeat each other from the start.
COLLAPSE, NARROW = 0.5, 0.5
#: The context of a step, from the step; for masks, which know the parent and the scale alone.
ContextOf = Callable[[Step], Context]


class Learner(TakesPart):
    """Asks `policy` for groups of answers, and trains it on what they were worth; a proposer in the
    sense of `ibrid_search.proposal`.

    Answers follow from the weights, the seed of the run and the number of their context, so they
    are the same after a resume. `rounds` : which step is which answer. Tokens and served
    log-probabilities are kept in the steps, weights in the folder of the run.
    """

    attempts = 1
    window: int | None = None

    def __init__(
        self, policy: Policy, settings: LearningSettings, *, seed: int, window: int
    ) -> None:
        self.policy, self.settings, self.seed = policy, settings, seed
        self.name = policy.name
        self.rounds = Rounds(
            policy.name,
            settings.contexts,
            settings.handed_in,
            window,
            waits=settings.judge == "fit",
        )
        self.progress = LearningState(policy, settings, seed)
        self._answers: tuple[int, list[Sampled]] | None = None  # of the context under way
        self._prompt: tuple[int, list[int]] | None = None  # of the context under way
        self._told = -1  # the last context whose question is in a step
        self._sampling = 0.0

    def begin(self, store: Store, folder: Path) -> None:
        """Keep the weights in the folder and the text about the updates in the store, and go on
        from what is there.
        """
        self.progress.path, self.progress.keep = inside(folder, CHECKPOINT), store.set_meta

    @property
    def updates(self) -> list[Update]:
        """What was learnt so far."""
        return self.progress.updates

    def note(self, step: Step) -> None:
        """Find the place of a step, made now or in an earlier sitting."""
        mine = step.number > 0 and step.proposer == self.name
        context = self.rounds.next.context
        self.rounds.add(step)
        if mine and "prompt" in (found := kept(step)):
            self._prompt, self._told = (context, list(found["prompt"])), context

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """The next answer of the group, which is drawn when its first answer is asked for; or the
        one that is handed in of all answers to a question, where first looks judge them.
        """
        place = self.rounds.next
        self.progress.require_seen(self.rounds.batches)  # weights that cannot be had end the run
        try:
            group = self._group(place, context)
            if self.settings.judge == "look":
                best = bool(rng.random() < LOOKED_AT)
                found = asked(self.policy, group, context, rng, look=True, best=best)
                proposal, told = found.proposal, kept_answers(found)
            else:
                one = group[place.member]
                proposal, told = self.policy.proposal(one, context), kept_answer(one)
        except IbridError as error:
            return Proposal("", failure=str(error))
        if self._told != place.context and self._prompt is not None:
            told["prompt"] = self._prompt[1]
        return replace(proposal, usage={**proposal.usage, KEPT: asdict(place) | told})

    def horizon(self) -> int:
        """The last step whose result the next question sees."""
        return self.rounds.horizon

    def origin(self, number: int) -> Origin:
        """Answers to one question share its parent; with a new question the active island goes
        round.
        """
        return Origin(self.rounds.next.context, self.rounds.leader)

    def learn(self, steps: Sequence[Step], context: ContextOf) -> None:
        """Update the weights once a batch is complete, all results of which are in where they
        matter; kept on disk before this returns.
        """
        if not self.rounds.complete or self.progress.seen >= self.rounds.batches:
            return
        began, settings = time.monotonic(), self.settings
        self.progress.require_seen(self.rounds.batches - 1)
        batch = [steps[number] for number in self.rounds.numbers]
        found = list(questions(batch, steps, settings))
        given = [one for question in found for one in question.given]
        advantages = batch_advantages(
            [one.worth for one in given],
            settings.group,
            advantages=settings.advantages,
            baseline=settings.baseline,
            floor=settings.floor,
            least=settings.least,
        )
        taught = [
            (question, one)
            for question, one in zip(found, advantages, strict=True)
            if one is not None
        ]
        groups = [self._of(question, one, context(question.step)) for question, one in taught]
        update = Update(
            number=self.progress.seen + 1,
            first=batch[0].number,
            last=batch[-1].number,
            gain=mean_of_known(one.worth for one in given) if settings.by_gain else None,
            dropped=settings.contexts - len(taught),
            tokens=float(np.mean([len(one.sampled.tokens) if one.sampled else 0 for one in given])),
            seconds_sampling=self._sampling,
            remark=self.progress.stopped,
            **counted([one.rewarded for one in given]),
        )
        if groups and not self.progress.stopped:
            update = replace(update, **asdict(self.progress.trainer.update(groups)))
            update = self._proven(update, groups[0].prompt, context(taught[0][0].step))
        update = replace(
            update,
            remark="; ".join(filter(None, (update.remark, _narrowing(update, self.updates)))),
        )
        update = replace(update, seconds_update=time.monotonic() - began)
        self.progress.conclude(update)
        self._sampling = 0.0

    # --- sampling
    # ------------------------------------------------------------------------------------------

    def _group(self, place: AnswerPlace, context: Context) -> list[Sampled]:
        """All answers of the context under way."""
        if self._answers is None or self._answers[0] != place.context:
            if self._prompt is None or self._prompt[0] != place.context:
                self._prompt = (place.context, list(self.policy.prompt(context)))
            self._answers = (
                place.context,
                self._timed(context, self.settings.group, (1, place.context)),
            )
        return self._answers[1]

    def _timed(self, context: Context, number: int, what: tuple[int, ...]) -> list[Sampled]:
        """Answers to the question under way."""
        began = time.monotonic()
        drawn = self._sampled(
            [] if self._prompt is None else self._prompt[1], context, number, what
        )
        self._sampling += time.monotonic() - began
        return drawn

    def _sampled(
        self, prompt: Sequence[int], context: Context, number: int, what: tuple[int, ...]
    ) -> list[Sampled]:
        seed = int(np.random.default_rng([self.seed, *what]).integers(2**63))
        with threads(self.settings.threads):
            return self.policy.sample([prompt], [context], number, seed)[0]

    # --- learning
    # ------------------------------------------------------------------------------------------

    def _of(self, question: GivenQuestion, advantages: np.ndarray, context: Context) -> "Group":
        """The answers to a question that teach something."""
        known = np.isfinite(advantages)
        answers = [
            one.sampled
            for one, has in zip(question.given, known, strict=True)
            if has and one.sampled
        ]
        return self._made(question.prompt, answers, context, advantages[known])

    def _made(
        self,
        prompt: Sequence[int],
        answers: Sequence[Sampled],
        context: Context,
        advantages: np.ndarray,
    ) -> "Group":
        from ibrid_policy.learning.trainer import Group

        masks = tuple(self.policy.masks(prompt, one.tokens, context) for one in answers)
        return Group(tuple(prompt), tuple(answers), masks, advantages)

    def _proven(self, update: Update, prompt: Sequence[int], asked: Context) -> Update:
        """Draw answers to a question of the batch once more and compare what is served with what is
        trained.
        """
        if not update.updated:
            self.progress.stopped = _sentence(
                "the answers of this batch were served by other weights", update.drift, "stopped"
            )
            return replace(update, remark=self.progress.stopped)
        self.progress.publish()
        answers = self._sampled(prompt, asked, PROBES, (2, update.number))
        found = self.progress.trainer.probe(
            self._made(prompt, answers, asked, np.zeros(len(answers)))
        )
        update = replace(update, probe=found.drift, handed=found.share if found.told else None)
        if found.other or not found.drift <= self.settings.stop:
            self.progress.stopped = _sentence(
                "after this update other weights are served", found.drift, "stopped"
            )
            return replace(update, remark=self.progress.stopped)
        worst = max(found.drift, update.drift or 0.0)
        if worst > self.settings.alarm:
            return replace(
                update,
                remark=_sentence("served and trained policy begin to differ", worst, "alarm"),
            )
        if not found.told:
            return replace(update, remark=UNTOLD)
        return update


def _sentence(what: str, drift: float | None, word: str) -> str:
    end = "; nothing is trained any more" if word == "stopped" else ""
    return f"{what}: log-probabilities differ by {drift or 0.0:.2g} in the mean{end}"


def _narrowing(update: Update, before: Sequence[Update]) -> str:
    """A sentence where the answers have become few."""
    first = next((one.entropy for one in before if one.entropy is not None), None)
    if (
        first is None
        or update.entropy is None
        or update.siblings <= COLLAPSE
        or update.entropy > NARROW * first
    ):
        return ""
    return (
        f"{100 * update.siblings:.0f} % of the answers repeat another of their batch, and the "
        f"entropy fell from {first:.2g} to "
        f"{update.entropy:.2g} nats per token: the policy narrows down"
    )
