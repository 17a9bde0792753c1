"""The answers of a batch, question by question, with what they were worth; read from the steps that
hold them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isinf
from typing import Any

from ibrid_search.step import Status, Step, rl_reward

from ibrid_policy.asking import JudgedAnswers
from ibrid_policy.interface import Sampled
from ibrid_policy.learning.advantages import Rewarded, gain, rewarded
from ibrid_policy.learning.settings import LearningSettings

#: What a step keeps of its answer, or of all answers to its question, in its `usage`.
KEPT = "learning"


@dataclass(frozen=True)
class Given:
    """An answer. `sampled` : None for one that never came.

    `worth` : what it is compared by; None where it never came or was never judged.
    """

    sampled: Sampled | None
    rewarded: Rewarded
    worth: float | None


@dataclass(frozen=True)
class GivenQuestion:
    """`step` : the first that holds an answer to it.

    `prompt` : its tokens. `given` : the answers, as many as a group has.
    """

    step: Step
    prompt: tuple[int, ...]
    given: tuple[Given, ...]


def kept(step: Step) -> Mapping[str, Any]:
    """What a step keeps for learning."""
    found = step.usage.get(KEPT, {})
    return found if isinstance(found, Mapping) else {}


def kept_answer(sampled: Sampled) -> dict[str, Any]:
    """Of an answer, for the store."""
    return {"tokens": list(sampled.tokens), "logprobs": list(sampled.logprobs)}


def kept_answers(found: JudgedAnswers) -> dict[str, Any]:
    """Of all answers to a question that first looks judged: one that leads to something new has the
    reward that its look says, at least; without a response it failed.
    """
    told, seen = [], set()
    for one in found.answers:
        end = {"status": str(one.status)}
        if one.look is not None and isinf(one.look.error):
            end = {"status": str(Status.FAILED)}
        elif one.look is not None:
            end = {
                "status": str(Status.OK),
                "reward": max(-one.look.error, 0.0),
                "sibling": one.hash in seen,
            }
            seen.add(one.hash)
        told.append(kept_answer(one.sampled) | end)
    return {"answers": told}


def questions(
    batch: Sequence[Step], steps: Sequence[Step], settings: LearningSettings
) -> Iterator[GivenQuestion]:
    """The questions of a batch in their order; `steps` are all of the run."""
    for first in range(0, len(batch), settings.handed_in):
        members = batch[first : first + settings.handed_in]
        parent = steps[members[0].parent or 0]
        found = (
            _looked(members[0], settings)
            if settings.judge == "look"
            else _fitted(members, batch[0].number, steps)
        )
        given = tuple(
            Given(sampled, one, _worth(sampled, one, parent, settings)) for sampled, one in found
        )
        prompt = next((tuple(kept(one)["prompt"]) for one in members if "prompt" in kept(one)), ())
        yield GivenQuestion(members[0], prompt, given)


def _fitted(
    members: Sequence[Step], first: int, steps: Sequence[Step]
) -> Iterator[tuple[Sampled | None, Rewarded]]:
    for step in members:
        told = kept(step)
        yield _sampled(told) if "tokens" in told else None, rewarded(step, steps, first)


def _looked(step: Step, settings: LearningSettings) -> Iterator[tuple[Sampled | None, Rewarded]]:
    answers = kept(step).get("answers")
    if answers is None:  # there was no answer at all, and the step says why
        yield from [
            (None, Rewarded(rl_reward(step.status, None), step.status, False))
        ] * settings.group
        return
    for one in answers:
        end = Status(one["status"])
        yield (
            _sampled(one),
            Rewarded(rl_reward(end, one.get("reward")), end, one.get("sibling", False)),
        )


def _worth(
    sampled: Sampled | None, one: Rewarded, parent: Step, settings: LearningSettings
) -> float | None:
    if sampled is None:
        return None
    return gain(one, parent, settings.most_gain) if settings.by_gain else one.reward


def _sampled(told: Mapping[str, Any]) -> Sampled:
    return Sampled(tuple(told["tokens"]), tuple(told["logprobs"]))
