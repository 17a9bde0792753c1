"""A search for a gap as who waits for it sees it: how far it is, how long it may take, and what it
knows so far.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ibrid.telling import Tell

if TYPE_CHECKING:
    from ibrid.gap.results.gap import Gap

#: Seconds between two answers on the way, and those for each that an answer takes.
EVERY, COSTS = 10.0, 20.0


@dataclass
class ProgressReporter:
    """`tell` : is told (words, share of the whole).

    `passed_on` : is given what would be answered now, every `EVERY` seconds at most. The clock is
    for who waits alone: how much is done is the matter of a `Budget`.
    """

    tell: Tell = lambda words, share: None
    passed_on: "Callable[[Gap], None] | None" = None
    began: float = field(default_factory=time.monotonic)
    _done: float = 0.0
    _upto: float = 0.0
    _share: float = 0.0
    _next: float = field(default_factory=lambda: EVERY)

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self.began

    def stage(self, part: float) -> None:
        """What follows is about this part of what is left to be done."""
        self._done = max(self._done, self._upto)
        self._upto = self._done + part * (1.0 - self._done)

    def __call__(self, done: int, of: int, words: str) -> None:
        """A piece of work begins, which words say; so many pieces of the stage are done."""
        share = max(self._share, self._done + (self._upto - self._done) * done / max(of, 1))
        self._share = share
        left = f", about {self.elapsed * (1.0 - share) / share:.0f} s left" if share > 0 else ""
        self.tell(f"{words}, {self.elapsed:.0f} s{left}", share)

    def so_far(self, answer: "Callable[[], Gap]") -> None:
        """Pass on what is known, unless that was done just now."""
        if self.passed_on is not None and self.elapsed >= self._next:
            begun = self.elapsed
            self.passed_on(answer())
            self._next = self.elapsed + max(EVERY, COSTS * (self.elapsed - begun))
