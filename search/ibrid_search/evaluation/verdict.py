"""One evaluation, and the word for how it ended; the same in this process and on a worker."""

import time
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

from ibrid.errors import IbridError
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.interrupts import heed_interrupt
from ibrid.modules.vocabulary import Vocabulary
from ibrid_search.evaluation.job import Job
from ibrid_search.screening.candidate_problems import NO_FIT_ERRORS
from ibrid_search.step import Status

#: What became of a step, by the outcome of its record.
STATUS = {
    Outcome.OK: Status.OK,
    Outcome.INVALID: Status.ILLEGAL,
    Outcome.FAILED: Status.FAILED,
    Outcome.UNFINISHED: Status.UNFINISHED,
}


class Assessing(Protocol):
    """What workers do with a job: it travels to each of them once. `kinds` : of the records that it
    makes.
    """

    @property
    def kinds(self) -> Vocabulary: ...

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


def judge(job: Job, assessor: Assessing) -> Verdict:
    """Assess a job.

    What a user's own kind breaks off with makes the candidate fail; a mistake of ours does not: it
    is lost.
    """
    started = time.perf_counter()
    return replace(_judge(job, assessor), seconds=time.perf_counter() - started)


def without_vocabulary(verdict: Verdict) -> Verdict:
    """The same to be sent to the search, which has the vocabulary of the record."""
    return (
        verdict
        if verdict.record is None
        else replace(verdict, record=replace(verdict.record, vocabulary=()))
    )


def ended(why: str) -> Verdict:
    """The verdict on a job whose process was ended from outside before it had an answer."""
    return Verdict(
        Status.UNFINISHED,
        reason=f"the process {why} and was ended, so nothing is known of what it worked on; go on "
        "with --resume to try again, "
        "or mend the kind of your own that hangs",
    )


def broken(error: BaseException) -> Verdict:
    """The verdict where ibrid itself broke off, which is not the candidate's fault."""
    first = (str(error).strip().splitlines() or ["no message"])[0][:300]
    return Verdict(
        Status.LOST,
        reason="a mistake in ibrid, please report it: the evaluation broke off with "
        f"{type(error).__name__}: {first}",
    )


def _judge(job: Job, assessor: Assessing) -> Verdict:
    try:
        record = assessor.assess(job)
    except IbridError as error:
        return Verdict(Status.FAILED, reason=str(error))
    except NO_FIT_ERRORS as error:
        return Verdict(
            Status.FAILED,
            reason=f"its numbers leave the range of arithmetic ({type(error).__name__}: {error})",
        )
    except Exception as error:
        heed_interrupt()
        return broken(error)
    return Verdict(STATUS[Outcome(record.outcome)], record, "; ".join(record.reasons))
