"""Evaluates jobs in this process, one after the other, when their results are asked for."""

from ibrid_search.evaluation.assess import Assessor
from ibrid_search.evaluation.job import Evaluator, Job, OpenJobs, Result
from ibrid_search.evaluation.verdict import judge
from ibrid_search.step import Status


class LocalEvaluator(Evaluator):
    """The evaluator for small searches and tests.

    A candidate that the wall limit (s) stopped is tried once more, as on workers: the machine may have been busy. The limit
    interrupts Python code alone, and only in the main thread; code that blocks elsewhere needs workers.
    """

    capacity = 1

    def __init__(self, assessor: Assessor, *, wall: float = 60.0):
        self.assessor, self.wall = assessor, wall
        self._jobs = OpenJobs()

    def submit(self, job: Job) -> None:
        """Keep the job until it is collected; IbridError when its number waits already."""
        self._jobs.add(job)

    def first_ended(self) -> int:
        """Evaluate the oldest waiting job, unless one has a result already; IbridError when nothing waits."""
        while (number := self._jobs.first_with_result()) is None:
            self._jobs.settle(self._evaluate(self._jobs.first_without_result()))
        return number

    def collect(self, number: int) -> Result:
        """Evaluate the waiting jobs in the order of their submission up to that one; IbridError when it does not wait."""
        while (result := self._jobs.take(number)) is None:
            self._jobs.settle(self._evaluate(self._jobs.first_without_result()))
        return result

    def close(self) -> None:
        """Drop what waits."""
        self._jobs.close()

    def _evaluate(self, job: Job) -> Result:
        attempts, verdict = 1, judge(job, self.assessor, self.wall)
        seconds = verdict.seconds
        if verdict.outcome is Status.TIMEOUT:
            attempts, verdict = 2, judge(job, self.assessor, self.wall)
            seconds += verdict.seconds
        return Result(job.number, verdict.outcome, verdict.record, verdict.reason, seconds, attempts)
