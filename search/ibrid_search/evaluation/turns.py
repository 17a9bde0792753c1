"""Whose turn it is: jobs begin in the order of their coming, and what a limit stopped runs again with nothing beside it."""

from collections import deque
from dataclasses import dataclass

from ibrid_search.evaluation.job import Job


@dataclass(frozen=True)
class Attempt:
    """A job and its history: how often the wall limit stopped it, how often its worker was lost, seconds spent so far."""

    job: Job
    stops: int = 0
    losses: int = 0
    seconds: float = 0.0

    @property
    def number(self) -> int:
        """Which attempt the next one is, from 1."""
        return self.stops + self.losses + 1

    @property
    def alone(self) -> bool:
        """True when nothing else may run beside it."""
        return self.stops > 0


class Turns:
    """A queue of attempts and the count of those that run. Says what may begin; who uses it from threads holds a lock."""

    def __init__(self) -> None:
        self._queue: deque[Attempt] = deque()
        self._alone: deque[Attempt] = deque()
        self._running: set[int] = set()
        self._exclusive = False

    @property
    def running(self) -> frozenset[int]:
        """Numbers of the jobs that run now."""
        return frozenset(self._running)

    def add(self, attempt: Attempt) -> None:
        """A new attempt queues; a later one comes before the jobs that have not begun, since others wait for its result."""
        if attempt.alone:
            self._alone.append(attempt)
        elif attempt.number > 1:
            self._queue.appendleft(attempt)
        else:
            self._queue.append(attempt)

    def begin(self) -> Attempt | None:
        """The attempt that begins now, None when none may."""
        if self._exclusive or (self._alone and self._running):
            return None
        if self._alone:
            self._exclusive = True
            attempt = self._alone.popleft()
        elif self._queue:
            attempt = self._queue.popleft()
        else:
            return None
        self._running.add(attempt.job.number)
        return attempt

    def end(self, attempt: Attempt) -> None:
        """The attempt does not run any more."""
        self._running.discard(attempt.job.number)
        self._exclusive = False
