"""Progress of a search for a gap: the share that is done, the time left, intermediate results."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ibrid.telling import Tell, silent

if TYPE_CHECKING:
    from ibrid.gap.results.gap import Gap

#: Seconds between two intermediate results at least; and the least ratio of that time to the time
#: that one takes.
EVERY = 10.0
LEAST_RATIO = 20.0


@dataclass
class ProgressReporter:
    """Reports progress and intermediate results.

    Its clock serves the display alone; how much work is done is decided by a `Budget`.

    Parameters
    ----------
    tell : Tell
        Is given a message and the share that is done.
    receive : callable or None
        Is given the intermediate result, every `EVERY` seconds at most.
    """

    tell: Tell = silent
    receive: "Callable[[Gap], None] | None" = None
    started: float = field(default_factory=time.monotonic)
    _stage_begin: float = 0.0
    _stage_end: float = 0.0
    _share: float = 0.0
    _next: float = field(default_factory=lambda: EVERY)

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self.started

    def begin_stage(self, part: float) -> None:
        """Begin a stage that is this part of what is left to do."""
        self._stage_begin = max(self._stage_begin, self._stage_end)
        self._stage_end = self._stage_begin + part * (1.0 - self._stage_begin)

    def __call__(self, done: int, total: int, words: str) -> None:
        """Report that the next piece of work begins, after `done` of `total` pieces of a stage."""
        length = self._stage_end - self._stage_begin
        share = max(self._share, self._stage_begin + length * done / max(total, 1))
        self._share = share
        left = ""
        if share > 0:
            left = f", about {self.elapsed * (1.0 - share) / share:.0f} s left"
        self.tell(f"{words}, {self.elapsed:.0f} s{left}", share)

    def report_result(self, build_result: "Callable[[], Gap]") -> None:
        """Build the intermediate result and pass it on, unless that was done just now."""
        if self.receive is None or self.elapsed < self._next:
            return
        begun = self.elapsed
        self.receive(build_result())
        self._next = self.elapsed + max(EVERY, LEAST_RATIO * (self.elapsed - begun))
