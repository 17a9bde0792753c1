"""What language models may cost a run, and what they have cost so far."""

from collections.abc import Mapping
from math import inf
from typing import Any

from search.proposers.language_model import Limits

_UNITS = {"tokens": "tokens", "cost": "of cost", "seconds": "s"}


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
