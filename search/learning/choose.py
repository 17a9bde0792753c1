"""Which of the proposers of a run learns, and what each that can becomes when it does."""

from collections.abc import Sequence

from ibrid.errors import IbridError
from search.learning.adapters import require_peft
from search.learning.learner import Learner
from search.learning.settings import OF_LANGUAGE_MODELS, LearningSettings
from search.policy.interface import Policy
from search.proposal import Proposer
from search.proposers.language_model import LanguageModel
from search.proposers.local_model import LocalModel
from search.proposers.policy import PolicyProposer


def learning(
    proposers: Sequence[tuple[Proposer, float]], settings: LearningSettings, *, seed: int, window: int
) -> tuple[tuple[Proposer, float], ...]:
    """The proposers with the one that can learn in its learning form; the others stay as they are.

    seed, window : of the run and its settings. Raises IbridError unless exactly one of them can learn: the policy, or a
    language model in one folder on this machine. Also where its weights cannot be loaded, or adapters are asked for
    without peft.
    """
    found = tuple((_learner(one, settings, seed, window) or one, weight) for one, weight in proposers)
    number = sum(isinstance(one, Learner) for one, _ in found)
    if number != 1:
        names = ", ".join(one.name for one, _ in proposers)
        raise IbridError(
            f"--learn needs a proposer that learns, and one alone: found {number} among {names}; give --proposer policy, or "
            "--proposer llm with one --model FOLDER on this machine"
        )
    return found


def _learner(one: Proposer, settings: LearningSettings, seed: int, window: int) -> Learner | None:
    if isinstance(one, Learner):
        return one
    policy = _policy(one, settings)
    if policy is None:
        return None
    if settings.lora:
        require_peft()
    policy.model()  # what cannot be loaded ends the run here, before anything is fitted
    return Learner(policy, settings, seed=seed, window=window)


def _policy(one: Proposer, settings: LearningSettings) -> Policy | None:
    if isinstance(one, PolicyProposer):
        _require_none_of_language_models(settings)
        return one.policy
    if not isinstance(one, LanguageModel):
        return None
    if len(one.models) != 1 or not isinstance(one.models[0], LocalModel):
        raise IbridError(
            "--learn trains a model whose weights are at hand: one --model FOLDER on this machine; a model of a server, or one "
            "of several, cannot be trained"
        )
    if one.spending.limits.tokens < float("inf") or one.spending.limits.seconds < float("inf"):
        raise IbridError("limits of tokens and seconds do not hold for a model that is trained; leave them out")
    from search.learning.text_policy import TextPolicy

    return TextPolicy(
        one.models[0].folder,
        longest=settings.longest,
        prompt_tokens=min(one.prompt_tokens, settings.question),
        constrained=settings.constrained,
        lines=settings.lines,
    )


def _require_none_of_language_models(settings: LearningSettings) -> None:
    """Raise IbridError for a setting that says nothing to the policy, whose answers are short and legal edits anyway."""
    for name in OF_LANGUAGE_MODELS:
        if getattr(settings, name) != getattr(LearningSettings, name):
            raise IbridError(
                f"--learn-{name} belongs to a language model, and the policy writes short, legal edits anyway; leave it out, or "
                "give --proposer llm with one --model FOLDER on this machine"
            )
