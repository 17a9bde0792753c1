"""Proposers by name and weight, as a user gives them: "rules", "rules:0.7,random:0.3", or objects of one's own."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf
from pathlib import Path

from ibrid.errors import IbridError, near
from ibrid.plugins import plugin_proposers
from ibrid_search.policy_package import policy_part
from ibrid_search.proposal import Proposer
from ibrid_search.proposers.agent import Agent
from ibrid_search.proposers.language_model import LanguageModel
from ibrid_search.proposers.random_edits import RandomEdits
from ibrid_search.proposers.rules import Rules
from ibrid_search.spending import Limits, Prices

Weighted = tuple[tuple[Proposer, float], ...]
#: Proposers that ask a language model.
ASKING = ("llm", "agent")


def choose_proposers(
    chosen: str | Proposer | Sequence[tuple[Proposer, float]],
    models: Sequence[str] = (),
    limits: Limits | None = None,
    prices: Prices = (),
    policy: str | Path | None = None,
) -> Weighted:
    """Proposers with their weights.

    chosen : "NAME[:WEIGHT],...", one proposer, or pairs. models, limits, prices : for "llm" and "agent". policy : folder of
    the weights for "policy"; None: those that ship.
    Raises IbridError for an unknown name, a weight that is not positive, models that are missing or not usable, a limit
    of cost without prices, and any of these options where nobody asks a model.
    """
    limits = limits or Limits()
    if isinstance(chosen, str):
        named = _parsed(chosen, _makers(models, limits, prices, policy))
        names = {one for one, _, _ in named}
        _require_asked(names, models, limits, prices)
        _require_policy(names, policy)
        return tuple((make(), weight) for _, make, weight in named)
    _require_asked(["proposers of your own"], models, limits, prices)
    _require_policy(["proposers of your own"], policy)
    pairs = (
        [(chosen, 1.0)] if isinstance(chosen, Proposer) else list(chosen) if isinstance(chosen, Iterable) else [chosen]
    )
    for one in pairs:
        if not (isinstance(one, tuple) and len(one) == 2 and isinstance(one[0], Proposer) and _is_weight(one[1])):
            raise IbridError(
                f"a proposer is given by name, as an object, or as (object, weight above zero), found {one!r:.80}"
            )
    if not pairs:
        raise IbridError("a search needs at least one proposer")
    return tuple(pairs)


def _is_weight(weight: object) -> bool:
    return isinstance(weight, int | float) and 0 < weight < float("inf")


def _makers(
    models: Sequence[str], limits: Limits, prices: Prices, policy: str | Path | None
) -> Mapping[str, Callable[[], Proposer]]:
    def required(name: str) -> Sequence[str]:
        _require(models, limits, prices, name)
        return models

    return {
        **plugin_proposers(),
        "rules": Rules,
        "random": RandomEdits,
        "llm": lambda: LanguageModel.from_options(required("llm"), limits=limits, prices=prices),
        "policy": lambda: _policy(policy),
        "agent": lambda: Agent.from_options(required("agent"), limits=limits, prices=prices),
    }


def _policy(folder: str | Path | None) -> Proposer:
    return policy_part("proposer").PolicyProposer(folder)


def _require_policy(names: Iterable[str], folder: str | Path | None) -> None:
    """Raise IbridError for weights that no proposer reads."""
    if folder is not None and "policy" not in names:
        raise IbridError(
            f"--policy belongs to the proposer policy, found {', '.join(sorted(names))} alone; give --proposer policy, or "
            "leave it out"
        )


def _require(models: Sequence[str], limits: Limits, prices: Prices, name: str) -> None:
    if limits.cost < inf and not any(sum(one) > 0 for one in prices):
        raise IbridError(
            "a limit of cost is never reached without prices; give --model-price IN,OUT, of a million tokens in and out"
        )
    if not models:
        raise IbridError(
            f"the proposer {name} needs a model; give --model NAME@http://host:port/v1, --model NAME with OPENAI_BASE_URL "
            "set, or --model FOLDER"
        )


def _require_asked(names: Iterable[str], models: Sequence[str], limits: Limits, prices: Prices) -> None:
    """Raise IbridError for what belongs to language models where no proposer asks one."""
    if not set(ASKING).isdisjoint(names):
        return
    given = {
        "--model": bool(models),
        "--model-tokens": limits.tokens < inf,
        "--model-cost": limits.cost < inf,
        "--model-seconds": limits.seconds < inf,
        "--model-price": bool(prices),
    }
    if found := [option for option, there in given.items() if there]:
        raise IbridError(
            f"{found[0]} belongs to the proposers {' and '.join(ASKING)}, found {', '.join(sorted(names))} alone; choose one of "
            "them, or leave it out"
        )


def _parsed(text: str, makers: Mapping[str, Callable[[], Proposer]]) -> list[tuple[str, Callable[[], Proposer], float]]:
    """(name, how it is made, weight) of each word."""
    found: list[tuple[str, Callable[[], Proposer], float]] = []
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
            raise IbridError(f"the proposer {word.strip()[:60]}: a weight is a number above zero, such as {name}:0.5")
        found.append((name, makers[name], weight))
    return found
