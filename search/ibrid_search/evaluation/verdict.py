"""One evaluation with its time limit, and the word for how it ended; the same in this process and on a worker."""

import time
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

from ibrid.errors import IbridError
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.evaluation.time_limit import time_limit
from ibrid.modules.vocabulary import Vocabulary
from ibrid_search.evaluation.job import Job
from ibrid_search.step import Status

#: What became of a step, by the outcome of its record.
STATUS = {
    Outcome.OK: Status.OK,
    Outcome.INVALID: Status.ILLEGAL,
    Outcome.FAILED: Status.FAILED,
    Outcome.TIMEOUT: Status.TIMEOUT,
}


class Assessing(Protocol):
    """What workers do with a job: it travels to each of them once. `kinds` : of the records that it makes. `limit` : seconds
    after which a fit gives up by itself."""

    @property
    def kinds(self) -> Vocabulary: ...

    @property
    def limit(self) -> float: ...

    def assess(self, job: Any) -> Record:
        """What the job asks for; IbridError, one sentence, where there is none."""
        ...

    def arrived(self) -> Self:
        """The same after a travel."""
        ...


@dataclass(frozen=True)
class Verdict:
    """How one attempt at a job ended: fields as in `Result`."""

    outcome: Status
    record: Record | None = None
    reason: str = ""
    seconds: float = 0.0


def judge(job: Job, assessor: Assessing, wall: float) -> Verdict:
    """Assess a job within `wall` seconds. Whatever the code of a user's own kind raises makes the candidate fail."""
    started = time.perf_counter()
    return replace(_judge(job, assessor, wall), seconds=time.perf_counter() - started)


def without_vocabulary(verdict: Verdict) -> Verdict:
    """The same to be sent to the search, which has the vocabulary of the record."""
    return verdict if verdict.record is None else replace(verdict, record=replace(verdict.record, vocabulary=()))


def stopped(wall: float) -> Verdict:
    """The verdict on a job that did not end within the limit."""
    return Verdict(
        Status.TIMEOUT,
        reason=f"the evaluation did not end within the limit of {wall:g} s, also when nothing else ran; "
        "simplify the diagram, or raise the limit: --seconds of a fleet, wall in the settings of a search",
    )


def _judge(job: Job, assessor: Assessing, wall: float) -> Verdict:
    try:
        with time_limit(wall):
            record = assessor.assess(job)
    except TimeoutError:
        return stopped(wall)
    except IbridError as error:
        return Verdict(Status.FAILED, reason=str(error))
    except (Exception, SystemExit) as error:  # code of a user's own kind may raise anything; the run goes on
        first = (str(error).strip().splitlines() or ["no message"])[0][:300]
        return Verdict(Status.FAILED, reason=f"the evaluation broke off with {type(error).__name__}: {first}")
    status = STATUS[Outcome(record.outcome)]
    if status is Status.TIMEOUT:
        return stopped(min(wall, assessor.limit))
    return Verdict(status, record, "; ".join(record.reasons))
