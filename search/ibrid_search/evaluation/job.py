"""One interface for evaluating candidates: a job goes in under its number, its result comes out under the same number."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self

from ibrid.evaluation.record import Record
from ibrid_search.step import Status


@dataclass(frozen=True)
class Job:
    """A program to be fitted.

    `number` : of its step. `warm` : operating point -> name -> value to begin from, such as the parent's parameters.
    `promising` : error, as the search measures it, below which the candidate deserves more effort. `free_before` : free
    numbers of the parent; None: not known.
    """

    number: int
    program: str
    warm: Mapping[str, Any] | None = None
    promising: float | None = None
    free_before: int | None = None


@dataclass(frozen=True)
class Result:
    """What became of a job.

    `outcome` : OK, ILLEGAL, FAILED, TIMEOUT or LOST. `record` : of OK, ILLEGAL and FAILED where there is one. `reason` : a
    sentence unless OK. `seconds` : that workers were busy with it. `attempts` : how often it began.
    """

    number: int
    outcome: Status
    record: Record | None
    reason: str
    seconds: float
    attempts: int


class Evaluator(Protocol):
    """Evaluates jobs. The same job has the same outcome, record and reason, whoever evaluates it and beside what."""

    @property
    def capacity(self) -> int:
        """How many jobs it can work on at a time."""
        ...

    def submit(self, job: Job) -> None:
        """Hand over a job; returns at once. IbridError when its number waits already."""
        ...

    def first_ended(self) -> int:
        """The number of a job that was submitted, has a result and was not collected; blocks until there is one.

        Raises IbridError when nothing waits, or when the workers are gone for good.
        """
        ...

    def collect(self, number: int) -> Result:
        """The result of that job, once; blocks until it is there and keeps the results of others.

        Raises IbridError when no such job waits, or when the workers are gone for good.
        """
        ...

    def close(self) -> None:
        """Stop everything it started; jobs that are not collected are dropped. Again does nothing."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...
