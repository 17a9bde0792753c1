"""Evaluates jobs in this process, one after the other, when their results are asked for."""

from ibrid_search.evaluation.assess import Assessor
from ibrid_search.evaluation.job import Evaluator, Job, OpenJobs, Result
from ibrid_search.evaluation.verdict import judge


class LocalEvaluator(Evaluator):
    """The evaluator for small searches and tests.

    A kind of one's own that never ends needs workers, which can be ended.
    """

    capacity = 1

    def __init__(self, assessor: Assessor):
        self.assessor = assessor
        self._jobs = OpenJobs()

    def submit(self, job: Job) -> None:
        """Keep the job until it is collected; IbridError when its number waits already."""
        self._jobs.add(job)

    def first_ended(self) -> int:
        """Evaluate the oldest waiting job, unless one has a result already; IbridError when nothing
        waits.
        """
        while (number := self._jobs.first_with_result()) is None:
            self._jobs.settle(self._evaluate(self._jobs.first_without_result()))
        return number

    def collect(self, number: int) -> Result:
        """Evaluate the waiting jobs in the order of their submission up to that one; IbridError
        when it does not wait.
        """
        while (result := self._jobs.take(number)) is None:
            self._jobs.settle(self._evaluate(self._jobs.first_without_result()))
        return result

    def close(self) -> None:
        """Drop what waits."""
        self._jobs.close()

    def _evaluate(self, job: Job) -> Result:
        verdict = judge(job, self.assessor)
        return Result(
            job.number, verdict.outcome, verdict.record, verdict.reason, verdict.seconds, 1
        )
