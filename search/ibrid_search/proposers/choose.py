"""Proposers by name and weight, as a user gives them: "rules", "rules:0.7,random:0.3", or objects
of one's own.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any, Protocol

from ibrid.border import methods_take_kinds, require_kinds
from ibrid.errors import IbridError, near
from ibrid.frozen import Frozen
from ibrid.plugins import plugin_proposers
from ibrid_search.archives.experience import FILE as EXPERIENCE
from ibrid_search.archives.experience import Experience, read_experience
from ibrid_search.chat.spending import QUESTIONS, Limits, Prices, Spender
from ibrid_search.policy_package import policy_part
from ibrid_search.proposal import Proposer
from ibrid_search.proposers.agent import Agent
from ibrid_search.proposers.diagnosis import Diagnosis
from ibrid_search.proposers.language_model import LanguageModel
from ibrid_search.proposers.random_edits import RandomEdits
from ibrid_search.proposers.rules import Rules
from ibrid_search.run.run_folder import digest

Weighted = tuple[tuple[Proposer, float], ...]
#: Proposers that ask a language model.
ASKING = ("llm", "agent")


class Learning(Protocol):
    """How a proposer learns; `ibrid_policy.learning.settings.LearningSettings` is one.

    `steps` : between two updates.
    """

    @property
    def steps(self) -> int: ...


@methods_take_kinds
@dataclass(frozen=True)
class Proposers(Frozen):
    """Who has the ideas of a search.

    `chosen` : "rules", "random", "policy", "llm", "agent", a mix such as "rules:0.7,random:0.3", a
    proposer of one's own, or pairs of proposers and their weights.
    `models` : for "llm" and "agent": "NAME@URL*WEIGHT" or folders of local models. `limits` : what
    they may spend in the whole run. `prices` : of a million tokens in and a million out; one pair
    for all models, or one for each.
    `prompt` : of the questions of "llm": "engineer", with the diagnosis of the parent, or "paper",
    the paper's own.
    `server` : how servers are asked, fields of `ibrid_search.proposers.chat_server.ChatServer`:
    form, effort, extra, temperature, max_tokens, timeout, retries; the latter four but retries of a
    local model too.
    `policy` : folder of the weights for "policy", or of an experience for "diagnosis", as `ibrid
    policy train` makes them; None: the weights that ship, no experience. `informed` : whether
    "policy" has the diagnosis of the parent among its answers.
    `learn` : train the proposer on the way, "policy" or "llm" with one local folder, "FOLDER@URL"
    where a server answers for it; True or "paper" is the paper's profile, batches of 512, "small"
    one for a few hundred evaluations; or `ibrid_policy.learning.settings.LearningSettings`. Needs
    the distribution ibrid-policy.
    """

    chosen: str | Proposer | Sequence[tuple[Proposer, float]] = "rules"
    models: Sequence[str] = ()
    limits: Limits = field(default_factory=Limits)
    prices: Prices = ()
    prompt: str = "engineer"
    server: Mapping[str, Any] = field(default_factory=dict)
    policy: str | Path | None = None
    informed: bool = True
    learn: bool | str | Learning = False

    def __post_init__(self) -> None:
        super().__post_init__()
        require_kinds(self)

    def weighted(self) -> Weighted:
        """The proposers with their weights, before they learn.

        Raises IbridError for an unknown name, a weight that is not positive, models that are
        missing or not usable, a limit of cost without prices, and any of these options where nobody
        asks a model.
        """
        named = _parsed(self.chosen, _makers(self)) if isinstance(self.chosen, str) else []
        names = {one for one, _, _ in named} or {"proposers of your own"}
        _require_asked(names, self)
        _require_policy(names, self.policy, experienced=self.experience is not None)
        made = tuple((make(), weight) for _, make, weight in named)
        spenders = [one for one, _ in made if isinstance(one, Spender)]
        for one in spenders:  # the limits are those of the run, whoever asks
            one.spending = spenders[0].spending
        return made or _own(self.chosen)

    def learning(self) -> Learning | None:
        """How they learn; None when they do not. Raises IbridError for an unknown profile."""
        if not self.learn and not isinstance(self.learn, str):
            return None
        known = policy_part("learning.settings")
        if self.learn is True or isinstance(
            self.learn, str
        ):  # an empty name is refused as any other
            return known.profile("paper" if self.learn is True else self.learn)
        return self.learn

    @property
    def experience(self) -> Experience | None:
        """What earlier searches teach the diagnosis, where `policy` is a folder of that."""
        if self.policy is None or not (Path(self.policy) / EXPERIENCE).is_file():
            return None
        return read_experience(Path(self.policy))

    def weights(self) -> Mapping[str, str]:
        """What run.toml says of the weights of the policy."""
        if self.policy is None:
            return {}
        name = EXPERIENCE if self.experience else policy_part("weights_folder").WEIGHTS_FILE
        return {
            "policy": str(self.policy),
            "policy_sha256": digest((Path(self.policy) / name).read_bytes()),
        }


def _own(chosen: Any) -> Weighted:
    pairs = (
        [(chosen, 1.0)]
        if isinstance(chosen, Proposer)
        else list(chosen)
        if isinstance(chosen, Iterable)
        else [chosen]
    )
    for pair in pairs:
        if not (
            isinstance(pair, tuple)
            and len(pair) == 2
            and isinstance(pair[0], Proposer)
            and _is_weight(pair[1])
        ):
            raise IbridError(
                "a proposer is given by name, as an object, or as (object, weight above zero), "
                f"found {pair!r:.80}"
            )
    if not pairs:
        raise IbridError("a search needs at least one proposer")
    return tuple(pairs)


def _is_weight(weight: object) -> bool:
    return isinstance(weight, int | float) and 0 < weight < float("inf")


def _makers(given: Proposers) -> Mapping[str, Callable[[], Proposer]]:
    asked: dict[str, Any] = {"limits": given.limits, "prices": given.prices, **given.server}

    def required(name: str) -> Sequence[str]:
        if given.limits.cost < inf and not any(sum(pair) > 0 for pair in given.prices):
            raise IbridError(
                "a limit of cost is never reached without prices; give --model-price IN,OUT, of a "
                "million tokens in and out"
            )
        if not given.models:
            raise IbridError(
                f"the proposer {name} needs a model; give --model NAME@http://host:port/v1, "
                "--model NAME with OPENAI_BASE_URL "
                "set, or --model FOLDER"
            )
        return given.models

    return {
        **plugin_proposers(),
        "diagnosis": lambda: Diagnosis(given.experience),
        "rules": Rules,
        "random": RandomEdits,
        "llm": lambda: LanguageModel.from_options(required("llm"), asked=given.prompt, **asked),
        "policy": lambda: policy_part("proposer").PolicyProposer(
            given.policy, informed=given.informed
        ),
        "agent": lambda: Agent.from_options(required("agent"), **asked),
    }


def _require_policy(names: Iterable[str], folder: str | Path | None, *, experienced: bool) -> None:
    """Raise IbridError for weights or an experience that no proposer reads."""
    reader = "diagnosis" if experienced else "policy"
    if folder is not None and reader not in names:
        raise IbridError(
            f"this --policy belongs to the proposer {reader}, found {', '.join(sorted(names))} "
            f"alone; give --proposer {reader}, "
            "or leave it out"
        )


def _require_asked(names: Iterable[str], proposers: Proposers) -> None:
    """Raise IbridError for what belongs to language models where no proposer asks one."""
    if proposers.prompt != "engineer" and "llm" not in names:
        raise IbridError(
            f"--prompt belongs to the proposer llm, found {', '.join(sorted(names))} alone; leave "
            "it out"
        )
    if not set(ASKING).isdisjoint(names):
        return
    limits = proposers.limits
    given = {
        "--model": bool(proposers.models),
        "--questions": limits.questions != QUESTIONS,
        "--model-tokens": limits.tokens < inf,
        "--model-cost": limits.cost < inf,
        "--model-seconds": limits.seconds < inf,
        "--model-price": bool(proposers.prices),
        **{f"--model-{name.replace('_', '-')}": True for name in proposers.server},
    }
    if found := [option for option, there in given.items() if there]:
        raise IbridError(
            f"{found[0]} belongs to the proposers {' and '.join(ASKING)}, found "
            f"{', '.join(sorted(names))} alone; choose one of "
            "them, or leave it out"
        )


def _parsed(
    text: str, makers: Mapping[str, Callable[[], Proposer]]
) -> list[tuple[str, Callable[[], Proposer], float]]:
    """(name, how it is made, weight) of each word."""
    weighted: list[tuple[str, Callable[[], Proposer], float]] = []
    for word in text.split(","):
        name, _, number = word.strip().partition(":")
        if name not in makers:
            known, hint = f"known are: {', '.join(makers)}", near(name, makers)
            hint = known if hint.startswith("known") else f"{hint} {known}"
            raise IbridError(f"there is no proposer {name[:40]!r}; {hint}")
        try:
            weight = float(number) if number else 1.0
        except ValueError:
            weight = 0.0
        if not _is_weight(weight):
            raise IbridError(
                f"the proposer {word.strip()[:60]}: a weight is a number above zero, such as "
                f"{name}:0.5"
            )
        weighted.append((name, makers[name], weight))
    return weighted
