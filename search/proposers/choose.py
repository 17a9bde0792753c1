"""Proposers by name and weight, as a user gives them: "rules", "rules:0.7,random:0.3", or objects of one's own."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf

from ibrid.errors import IbridError, near
from search.proposal import Proposer
from search.proposers.agent import Agent
from search.proposers.language_model import LanguageModel
from search.proposers.random_edits import RandomEdits
from search.proposers.rules import Rules
from search.proposers.spending import Limits, Prices

Weighted = tuple[tuple[Proposer, float], ...]


def choose_proposers(
    chosen: str | Proposer | Sequence[tuple[Proposer, float]],
    models: Sequence[str] = (),
    limits: Limits | None = None,
    prices: Prices = (),
) -> Weighted:
    """Proposers with their weights.

    chosen : "NAME[:WEIGHT],...", one proposer, or pairs. models, limits, prices : for "llm" and "agent".
    Raises IbridError for an unknown name, a weight that is not positive, models that are missing or not usable, or a limit
    of cost without prices.
    """
    if isinstance(chosen, str):
        return _parsed(chosen, _makers(models, limits or Limits(), prices))
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


def _makers(models: Sequence[str], limits: Limits, prices: Prices) -> Mapping[str, Callable[[], Proposer]]:
    def required(name: str) -> Sequence[str]:
        _require(models, limits, prices, name)
        return models

    return {
        "rules": Rules,
        "random": RandomEdits,
        "llm": lambda: LanguageModel.from_options(required("llm"), limits=limits, prices=prices),
        "policy": _policy,
        "agent": lambda: Agent.from_options(required("agent"), limits=limits, prices=prices),
    }


def _policy() -> Proposer:
    from search.proposers.policy import PolicyProposer  # torch, which it needs, is an extra

    return PolicyProposer()


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


def _parsed(text: str, makers: Mapping[str, Callable[[], Proposer]]) -> Weighted:
    found: list[tuple[Proposer, float]] = []
    for word in text.split(","):
        name, _, number = word.strip().partition(":")
        if name not in makers:
            raise IbridError(f"there is no proposer {name[:40]!r}; known are {', '.join(makers)}; {near(name, makers)}")
        try:
            weight = float(number) if number else 1.0
        except ValueError:
            weight = 0.0
        if not _is_weight(weight):
            raise IbridError(f"the proposer {word.strip()[:60]}: a weight is a number above zero, such as {name}:0.5")
        found.append((makers[name](), weight))
    return tuple(found)
