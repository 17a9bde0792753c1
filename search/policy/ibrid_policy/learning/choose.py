"""Which of the proposers of a run learns, and what each that can becomes when it does."""

from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from ibrid_search.chat.chat_server import ChatServer
from ibrid_search.proposal import Proposer
from ibrid_search.proposers.language_model import LanguageModel
from ibrid_search.proposers.local_model import LocalModel

from ibrid.errors import IbridError
from ibrid.study import Study
from ibrid.writing import inside
from ibrid_policy.interface import Policy
from ibrid_policy.learning.adapters import require_peft, require_rank
from ibrid_policy.learning.learner import Learner
from ibrid_policy.learning.settings import OF_LANGUAGE_MODELS, LearningSettings
from ibrid_policy.learning.weights_reload import reload_from_disk
from ibrid_policy.proposer import PolicyProposer
from ibrid_policy.small_policy import SmallPolicy

#: Folder in that of a run from which a server loads the weights.
SERVED = "served"


@runtime_checkable
class Bounded(Protocol):
    """A policy that holds only so many tokens."""

    def require_room(self, study: Study, program: str) -> None:
        """Raise IbridError unless a question about this program and an answer to it fit."""
        ...


def learning(
    proposers: Sequence[tuple[Proposer, float]],
    settings: LearningSettings,
    *,
    seed: int,
    window: int,
    study: Study,
    start: str,
    folder: Path,
) -> tuple[tuple[Proposer, float], ...]:
    """The proposers with the one that can learn in its learning form; all that are given stay as
    they are.

    seed, window : of the run and its settings. study, start : what is searched, and the program
    that it begins with.
    folder : of the run, for the weights that a server is to load.

    Raises IbridError unless exactly one of them can learn: the policy, or a language model in one
    folder on this machine, for which a server may answer. Also where its weights cannot be loaded,
    it has no room for a question, or adapters are asked for without peft or wider than it.
    """
    found = tuple(
        (_learner(one, settings, seed, window, folder) or one, weight) for one, weight in proposers
    )
    number = sum(isinstance(one, Learner) for one, _ in found)
    if number != 1:
        names = ", ".join(one.name for one, _ in proposers)
        raise IbridError(
            f"--learn needs a proposer that learns, and one alone: found {number} among {names}; "
            "give --proposer policy, or "
            "--proposer llm with one --model FOLDER on this machine"
        )
    for one, _ in found:
        if isinstance(one, Learner) and isinstance(one.policy, Bounded):
            one.policy.require_room(study, start)
    return found


def _learner(
    one: Proposer, settings: LearningSettings, seed: int, window: int, folder: Path
) -> Learner | None:
    if isinstance(one, Learner):
        return one
    policy = _policy(one, settings, folder)
    if policy is None:
        return None
    if settings.lora:
        require_peft()
    model = (
        policy.model()
    )  # what cannot be loaded or trained ends the run here, before anything is fitted
    if settings.lora:
        require_rank(model, settings.lora)
    return Learner(policy, settings, seed=seed, window=window)


def _policy(one: Proposer, settings: LearningSettings, folder: Path) -> Policy | None:
    if isinstance(one, PolicyProposer):
        _require_none_of_language_models(settings)
        policy = deepcopy(one.policy)  # whoever gave it may search with it again
        if isinstance(policy, SmallPolicy):
            policy.threads = settings.threads
        return policy
    if not isinstance(one, LanguageModel):
        return None
    if one.spending.limits.tokens < float("inf") or one.spending.limits.seconds < float("inf"):
        raise IbridError(
            "limits of tokens and seconds do not hold for a model that is trained; leave them out"
        )
    from ibrid_policy.learning.served_policy import ServedPolicy, Server
    from ibrid_policy.learning.text_policy import TextPolicy

    options: dict[str, Any] = {
        "longest": settings.longest,
        "prompt_tokens": settings.question,
        "constrained": settings.constrained,
        "lines": settings.lines,
    }
    alone = one.models[0] if len(one.models) == 1 else None
    if isinstance(alone, LocalModel):
        return TextPolicy(alone.folder, **options)
    if isinstance(alone, ChatServer) and Path(alone.model).expanduser().is_dir():
        key = alone.key()
        server = Server(
            alone.model, alone.url, key, alone.timeout, reload_from_disk(alone.url, key)
        )
        return ServedPolicy(
            Path(alone.model).expanduser(), server, inside(folder, SERVED), **options
        )
    raise IbridError(
        "--learn trains a model whose weights are at hand: one --model FOLDER on this machine, or "
        "FOLDER@http://host:port/v1 "
        "where a server answers for it; a model of a server alone, or one of several, cannot be "
        "trained"
    )


def _require_none_of_language_models(settings: LearningSettings) -> None:
    """Raise IbridError for a setting that says nothing to the policy, whose answers are short and
    legal edits anyway.
    """
    for name in OF_LANGUAGE_MODELS:
        if getattr(settings, name) != getattr(LearningSettings, name):
            raise IbridError(
                f"--learn-{name} belongs to a language model, and the policy writes short, legal "
                "edits anyway; leave it out, or "
                "give --proposer llm with one --model FOLDER on this machine"
            )
