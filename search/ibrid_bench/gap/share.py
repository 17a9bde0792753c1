"""A share of successes, and how sure it is: the interval of Wilson (1927)."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

#: Standard deviations of a 95 % interval.
Z = 1.959964


@dataclass(frozen=True)
class Share:
    """`hits` of `number`."""

    hits: int
    number: int

    @classmethod
    def of(cls, answers: Iterable[bool | None]) -> "Share":
        """Of the questions that arose."""
        known = [one for one in answers if one is not None]
        return cls(sum(known), len(known))

    @property
    def interval(self) -> tuple[float, float]:
        """95 %; (0, 1) of nothing."""
        if not self.number:
            return 0.0, 1.0
        n, p = self.number, self.hits / self.number
        centre = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
        half = Z / (1 + Z**2 / n) * sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
        return max(0.0, centre - half), min(1.0, centre + half)

    def __str__(self) -> str:
        """27/28 96% (82-99): the share and its interval in percent."""
        if not self.number:
            return "-"
        low, high = self.interval
        return (
            f"{self.hits}/{self.number} {_percent(self.hits / self.number)}% "
            f"({_percent(low)}-{_percent(high)})"
        )


def _percent(share: float) -> str:
    return f"{100 * share:.0f}"
