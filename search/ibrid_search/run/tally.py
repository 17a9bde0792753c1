"""What became of the proposals, counted."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ibrid_search.step import REFUSED, Status, Step

#: The count that a status belongs to; what is not here is a failure.
_PLACES = dict.fromkeys(REFUSED, "refused") | {
    Status.OK: "valid",
    Status.DUPLICATE: "duplicate",
    Status.UNCHANGED: "unchanged",
    Status.PENDING: "pending",
}


@dataclass(frozen=True)
class Tally:
    """Numbers of proposals.

    `refused` : before any evaluation. `failed` : evaluated without a usable answer.
    """

    valid: int = 0
    duplicate: int = 0
    unchanged: int = 0
    refused: int = 0
    failed: int = 0
    pending: int = 0

    @classmethod
    def of(cls, counts: Mapping[Status, int]) -> "Tally":
        """From a number for every status."""
        found: Counter[str] = Counter()
        for status, number in counts.items():
            found[_PLACES.get(Status(status), "failed")] += number
        return cls(**found)

    @property
    def answered(self) -> int:
        """Proposals whose end is known."""
        return self.valid + self.duplicate + self.unchanged + self.refused + self.failed

    def share(self, name: str) -> float:
        """The part of the answered proposals that ended so; 0 before the first."""
        return getattr(self, name) / self.answered if self.answered else 0.0


def counts(steps: Iterable[Step]) -> Counter[Status]:
    """How many proposals ended in which way; the start is none."""
    return Counter(step.status for step in steps if step.number > 0)
