"""What language models may cost a run, and what they have cost so far."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from ibrid.errors import IbridError

_UNITS = {"tokens": "tokens", "cost": "of cost", "seconds": "s"}


@dataclass(frozen=True)
class Limits:
    """What a whole run may spend: tokens in and out together, thinking included; cost in the currency of the prices;
    seconds of waiting for answers."""

    tokens: float = inf
    cost: float = inf
    seconds: float = inf

    def __post_init__(self) -> None:
        if not all(one > 0 for one in (self.tokens, self.cost, self.seconds)):
            raise IbridError("limits of tokens, cost and seconds must be above zero; leave one out for no limit")


class Spending:
    """Counts usage against `limits`; a run that resumes counts that of the steps in its store first."""

    def __init__(self, limits: Limits | None = None) -> None:
        self.limits = limits or Limits()
        self.spent: dict[str, float] = dict.fromkeys(_UNITS, 0.0)

    def count(self, usage: Mapping[str, Any]) -> None:
        """Add the usage of an answer, or of a whole step."""
        for name in ("prompt_tokens", "completion_tokens", "cost", "seconds"):
            value = usage.get(name, 0)
            if isinstance(value, int | float) and 0 <= value < inf:
                self.spent["tokens" if name.endswith("tokens") else name] += value

    @property
    def over(self) -> str:
        """The sentence that says which limit is spent; "" when none is."""
        for name, unit in _UNITS.items():
            limit = getattr(self.limits, name)
            if self.spent[name] >= limit:
                return f"the limit of {limit:g} {unit} of this run is spent; raise it or use another proposer"
        return ""
