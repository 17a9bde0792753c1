"""Slices of looks: who waits gets an answer after some seconds with what is there, and goes on by
asking the same again.

Looks are kept, so that what a slice has made is not made again, and the ranking at the end is that
of one go.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import monotonic
from typing import Generic, TypeVar

Look = TypeVar("Look")


class SliceOver(Exception):
    """Raised before a new look when the time of a slice has passed."""


@dataclass
class Slice(Generic[Look]):
    """One slice of looks.

    `seconds` : after which no new look begins, but for the first; None for no end. `looks` : met in
    it, known ones too. `left` : edits of the stage under way that were not looked at. `made` : new
    looks.
    """

    seconds: float | None
    looks: list[Look] = field(default_factory=list)
    left: int = 0
    made: int = 0
    begun: float = field(default_factory=monotonic)

    def before_look(self) -> None:
        """Raises SliceOver where no new look is to begin."""
        if self.seconds is not None and self.made and monotonic() - self.begun >= self.seconds:
            raise SliceOver
        self.made += 1

    def stage(self, edits: Sequence[object]) -> None:
        """A stage of so many edits begins."""
        self.left = len(edits)

    def met(self, look: Look) -> None:
        """A look was made, or was known."""
        self.looks.append(look)
        self.left = max(self.left - 1, 0)
