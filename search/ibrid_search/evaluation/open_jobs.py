"""Which jobs were handed over, which have a result, and which were asked for: the bookkeeping of every evaluator."""

from ibrid.errors import IbridError
from ibrid_search.evaluation.job import Job, Result


class OpenJobs:
    """Jobs from `add` to `take`, in the order in which they came."""

    def __init__(self) -> None:
        self._jobs: dict[int, Job] = {}
        self._results: dict[int, Result] = {}
        self._closed = False

    def add(self, job: Job) -> None:
        """Raises IbridError when the number is in use, or after `close`."""
        if self._closed:
            raise IbridError(f"job {job.number} came after the evaluator was closed; open a new one")
        if job.number in self._jobs:
            raise IbridError(f"two jobs must not have the number {job.number}; collect the first one before")
        self._jobs[job.number] = job

    def require(self, number: int) -> None:
        """Raises IbridError when no such job is open."""
        if number not in self._jobs:
            open_ones = ", ".join(map(str, self._jobs)) or "none"
            raise IbridError(f"job {number} was not submitted, or was collected before; open jobs: {open_ones}")

    def has_result(self, number: int) -> bool:
        """True when the job has ended."""
        return number in self._results

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

    def take(self, number: int) -> Result:
        """The result, once."""
        del self._jobs[number]
        return self._results.pop(number)

    def close(self) -> None:
        """Forget everything and take nothing more."""
        self._closed = True
        self._jobs.clear()
        self._results.clear()
