"""One interface for evaluating candidates: a job goes in under its number, its result comes out
under it; and the bookkeeping.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid_search.step import Status


@dataclass(frozen=True)
class Job:
    """A program to be fitted.

    `number` : of its step. `warm` : operating point -> name -> value to begin from, such as the
    parent's parameters.
    `promising` : error, as the search measures it, below which the candidate deserves more effort.
    `free_before` : free numbers of the parent; None: not known.
    """

    number: int
    program: str
    warm: Mapping[str, Any] | None = None
    promising: float | None = None
    free_before: int | None = None


@dataclass(frozen=True)
class Result:
    """What became of a job.

    `outcome` : OK, ILLEGAL, FAILED, UNFINISHED or LOST. `record` : of OK, ILLEGAL and FAILED where
    there is one. `reason` : a sentence unless OK. `seconds` : that workers were busy with it.
    `attempts` : how often it began.
    """

    number: int
    outcome: Status
    record: Record | None
    reason: str
    seconds: float
    attempts: int


class Evaluator(Protocol):
    """Evaluates jobs. The same job has the same outcome, record and reason, whoever evaluates it
    and beside what.

    Who inherits from it is closed at the end of a `with` block.
    """

    #: How many jobs it can work on at a time.
    capacity: int

    def submit(self, job: Job) -> None:
        """Hand over a job; returns at once. IbridError when its number waits already."""
        ...

    def first_ended(self) -> int:
        """The number of a job that was submitted, has a result and was not collected; blocks until
        there is one.

        Raises IbridError when nothing waits, or when the workers are gone for good.
        """
        ...

    def collect(self, number: int) -> Result:
        """The result of that job, once; blocks until it is there and keeps the results of others.

        Raises IbridError when no such job waits, or when the workers are gone for good.
        """
        ...

    def close(self) -> None:
        """Stop everything it started; jobs that are not collected are dropped.

        Again does nothing.
        """
        ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class OpenJobs:
    """Jobs from `add` to `take`, in the order in which they came."""

    def __init__(self) -> None:
        self._jobs: dict[int, Job] = {}
        self._results: dict[int, Result] = {}
        self._closed = False

    def add(self, job: Job) -> None:
        """Raises IbridError when the number is in use, or after `close`."""
        if self._closed:
            raise IbridError(
                f"job {job.number} came after the evaluator was closed; open a new one"
            )
        if job.number in self._jobs:
            raise IbridError(
                f"two jobs must not have the number {job.number}; collect the first one before"
            )
        self._jobs[job.number] = job

    def first_with_result(self) -> int | None:
        """The number of the oldest job that has ended and was not taken; None when there is none.

        Raises IbridError when no job is open.
        """
        if not self._jobs:
            raise IbridError("no job is open; submit one before asking which has ended")
        return next((number for number in self._jobs if number in self._results), None)

    def first_without_result(self) -> Job:
        """The oldest job that has not ended; there must be one."""
        return next(job for number, job in self._jobs.items() if number not in self._results)

    def settle(self, result: Result) -> None:
        """Keep a result until it is taken."""
        if result.number in self._jobs:
            self._results[result.number] = result

    def take(self, number: int) -> Result | None:
        """The result of a job, once; None while it has not ended.

        Raises IbridError when no such job is open.
        """
        if number not in self._jobs:
            open_ones = ", ".join(map(str, self._jobs)) or "none"
            raise IbridError(
                f"job {number} was not submitted, or was collected before; open jobs: {open_ones}"
            )
        if number in self._results:
            del self._jobs[number]
        return self._results.pop(number, None)

    def close(self) -> None:
        """Forget everything and take nothing more."""
        self._closed = True
        self._jobs.clear()
        self._results.clear()


@dataclass(frozen=True)
class Attempt:
    """A job and its history: how often its worker was lost, seconds spent so far."""

    job: Job
    losses: int = 0
    seconds: float = 0.0

    @property
    def number(self) -> int:
        """Which attempt the next one is, from 1."""
        return self.losses + 1


class Turns:
    """A queue of attempts and the count of those that run.

    Says what may begin; who uses it from threads holds a lock.
    """

    def __init__(self) -> None:
        self._queue: deque[Attempt] = deque()
        self._running: set[int] = set()

    @property
    def running(self) -> frozenset[int]:
        """Numbers of the jobs that run now."""
        return frozenset(self._running)

    def add(self, attempt: Attempt) -> None:
        """A new attempt queues; a later one comes before the jobs that have not begun, since others
        wait for its result.
        """
        if attempt.number > 1:
            self._queue.appendleft(attempt)
        else:
            self._queue.append(attempt)

    def begin(self) -> Attempt | None:
        """The attempt that begins now, None when none may."""
        if not self._queue:
            return None
        attempt = self._queue.popleft()
        self._running.add(attempt.job.number)
        return attempt

    def end(self, attempt: Attempt) -> None:
        """The attempt does not run any more."""
        self._running.discard(attempt.job.number)
