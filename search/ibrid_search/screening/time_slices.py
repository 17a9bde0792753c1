"""Screening in slices of limited wall time, for callers that must reply within seconds.

A slice that runs out of time returns what it has. The same request then continues: screening fits
are cached, so that the final ranking is the one of an uninterrupted run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf
from time import monotonic
from typing import Generic, TypeVar

ScreeningFitType = TypeVar("ScreeningFitType")


class TimeSliceOver(Exception):
    """Raised before a new screening fit when the time of the slice has passed."""


@dataclass
class TimeSlice(Generic[ScreeningFitType]):
    """Collect the screening fits of one slice of time.

    `seconds` : after which no new fit begins, except for the first; None for no limit. `fits` : all
    that were requested, cached ones included. `remaining` : candidates of the current stage that
    were not requested yet. `new_fits` : number of fits that were computed. `start_time` : of the
    monotonic clock, in s.
    """

    seconds: float | None
    fits: list[ScreeningFitType] = field(default_factory=list)
    remaining: int = 0
    new_fits: int = 0
    start_time: float = field(default_factory=monotonic)

    def check_time(self) -> None:
        """Count a new screening fit, or raise TimeSliceOver when the time has passed."""
        limit = inf if self.seconds is None or self.new_fits == 0 else self.seconds
        if monotonic() - self.start_time >= limit:
            raise TimeSliceOver
        self.new_fits += 1

    def begin_stage(self, candidates: Sequence[object]) -> None:
        """Reset the number of remaining candidates to those of a new stage."""
        self.remaining = len(candidates)

    def add(self, fit: ScreeningFitType) -> None:
        """Add a screening fit, computed or cached."""
        self.fits.append(fit)
        self.remaining = max(self.remaining - 1, 0)
