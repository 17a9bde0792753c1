"""Evaluates jobs by a crew of workers: back-pressure, an end from outside of what hangs, and lost
workers that do not count.

One thread of this process waits for each worker and starts the next when it dies; the state that
they share is changed under one condition. What a worker is, an actor of Ray or a process of this
machine, is known to who hires it alone.
"""

import atexit
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Generic, Protocol, TypeVar

from ibrid.errors import IbridError
from ibrid.modules.vocabulary import choose_vocabulary
from ibrid_search.evaluation.job import Attempt, Evaluator, Job, OpenJobs, Result, Turns
from ibrid_search.evaluation.verdict import Assessing, Verdict
from ibrid_search.step import Status

#: Seconds without any worker after which the evaluator gives up: as many waits of a second, since a
#: clock may jump.
PATIENCE = 300


#: One thread of computation per worker, so that as many workers as cores do not get in each other's
#: way.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
#: What is said where the data or a user's own kinds do not reach a worker: why.
NOT_PICKLABLE = (
    "the data and kinds must be picklable to travel to workers, found {}; state_space of a kind "
    "should use "
    "its arguments alone"
)
NOT_LOADED = (
    "a worker could not load the data and the kinds ({}); write kinds of your own in the notebook "
    "or script of the search, or "
    "install their module on every node"
)


class WorkerLost(Exception):
    """The worker's process or node is gone, whoever's fault that is."""


class CrewMember(Protocol):
    """A worker as the search sees it.

    `who` : "host pid N", "" until `prepare` has ended. `alive` : False once killed.
    """

    who: str
    alive: bool

    def prepare(self) -> None:
        """Wait until it has loaded the assessor.

        Raises IbridError when that cannot be, WorkerLost when it dies before.
        """
        ...

    def evaluate(self, job: Job) -> Verdict:
        """The verdict on a job; UNFINISHED when it had to be killed for it. Raises WorkerLost."""
        ...

    def kill(self) -> None:
        """End its process, whatever it is doing, native code included."""
        ...


Assessor = TypeVar("Assessor", bound=Assessing)


class CrewEvaluator(Evaluator, Generic[Assessor]):
    """An `Evaluator` on `workers` at most, each hired by `hire`, of one core.

    A worker has one job at a time, so what has not begun waits here and is never lost. A member
    ends the process of a job that hangs, which is then UNFINISHED. `lost` : workers that may die on
    a job before it counts as LOST.
    `patience` : seconds without any worker after which `first_ended` and `collect` give up. `leave`
    : called when all is closed.
    """

    def __init__(
        self,
        assessor: Assessor,
        workers: int,
        hire: Callable[[], CrewMember],
        *,
        lost: int,
        patience: int = PATIENCE,
        leave: Callable[[], None] = lambda: None,
    ):
        self.assessor, self.capacity = assessor, workers
        self.lost = lost
        self._hire, self._leave = hire, leave
        self._patience = patience
        self._change = threading.Condition()
        self._jobs = OpenJobs()
        self._turns = Turns()
        self._closed = False
        self._crew: list[CrewMember] = []
        self._deserted = True  # nobody of the crew is ready
        self._waits = 0  # of a second, since then
        self._serving = workers  # threads that can still hire
        self._why = ""  # the last of them could not
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(workers)]
        for thread in self._threads:
            thread.start()
        atexit.register(
            self.close
        )  # before Ray's own end, which threads that still wait would disturb

    @property
    def running(self) -> frozenset[int]:
        """Numbers of the jobs that are worked on now, at most `capacity`."""
        with self._change:
            return self._turns.running

    @property
    def workers(self) -> tuple[str, ...]:
        """The workers that are ready, as "host pid N"."""
        with self._change:
            return tuple(member.who for member in self._crew if member.who)

    def submit(self, job: Job) -> None:
        with self._change:
            self._jobs.add(job)
            self._turns.add(Attempt(job))
            self._change.notify_all()

    def first_ended(self) -> int:
        with self._change:
            while (number := self._jobs.first_with_result()) is None:
                self._wait()
            return number

    def collect(self, number: int) -> Result:
        with self._change:
            while (result := self._jobs.take(number)) is None:
                self._wait()
            return result

    def close(self) -> None:
        """Kill the workers and end what was started for them; again does nothing."""
        with self._change:
            if self._closed:
                return
            self._closed = True
            self._jobs.close()
            crew = tuple(self._crew)
            self._change.notify_all()
        for worker in crew:
            worker.kill()
        for thread in self._threads:
            thread.join(timeout=10)
        self._leave()
        atexit.unregister(self.close)

    def _wait(self) -> None:
        """Until something changes; IbridError when there are no workers and none comes."""
        if not self._serving:
            raise IbridError(self._why)
        if not self._deserted:
            self._change.wait()
            return
        if self._waits >= self._patience:
            raise IbridError(
                f"no worker was ready for {self._patience} s; see whether a core is free (ray "
                "status shows it of a cluster), "
                "then resume the search"
            )
        if not self._change.wait(1.0):
            self._waits += 1

    def _serve(self) -> None:
        """The life of a thread: a worker after the other, and with each a job after the other."""
        why, ended = "the workers are gone; resume the search", 1
        try:
            while (worker := self._ready_worker()) is not None:
                while worker.alive and (attempt := self._next_attempt()) is not None:
                    self._try(worker, attempt)
                self._dismiss(worker)
        except IbridError as error:
            why = str(error)
        except BaseException as error:  # a mistake in this file must not leave anybody waiting
            why, ended = f"the evaluator broke off ({type(error).__name__}: {error})", self.capacity
            raise
        finally:
            with self._change:
                self._serving = max(self._serving - ended, 0)
                self._why = why
                self._change.notify_all()

    def _ready_worker(self) -> CrewMember | None:
        """Somebody new who has loaded everything; None when closed.

        IbridError when nobody can be had.
        """
        lost = "none was tried"
        for _ in range(self.lost):
            with self._change:
                if self._closed:
                    return None
                worker = self._hire()
                self._crew.append(worker)
            try:
                worker.prepare()
            except (WorkerLost, IbridError) as error:
                self._dismiss(worker)
                if isinstance(error, IbridError):
                    raise
                lost = str(error)
                continue
            with self._change:
                self._deserted = False
                self._change.notify_all()
            return worker
        raise IbridError(
            f"{self.lost} workers in a row died while they started ({lost}); see whether memory is "
            "short"
        )

    def _next_attempt(self) -> Attempt | None:
        """Waits for a turn; None when closed."""
        with self._change:
            while not self._closed:
                if (attempt := self._turns.begin()) is not None:
                    return attempt
                self._change.wait()
        return None

    def _try(self, worker: CrewMember, attempt: Attempt) -> None:
        """Evaluate, then settle the job or queue it again."""
        started = time.perf_counter()
        died = False
        try:
            verdict = worker.evaluate(attempt.job)
        except WorkerLost as error:
            died = True
            verdict = Verdict(
                Status.LOST, reason=f"{self.lost} workers died on it, the last with {error}"
            )
        after = replace(
            attempt,
            losses=attempt.losses + died,
            seconds=attempt.seconds + time.perf_counter() - started,
        )
        with self._change:
            self._turns.end(attempt)
            if died and after.losses < self.lost:
                self._turns.add(after)
            else:
                if (record := verdict.record) is not None:
                    record = replace(record, vocabulary=choose_vocabulary(self.assessor.kinds))
                number, attempts = attempt.job.number, attempt.number
                self._jobs.settle(
                    Result(number, verdict.outcome, record, verdict.reason, after.seconds, attempts)
                )
            self._change.notify_all()

    def _dismiss(self, worker: CrewMember) -> None:
        """Nobody works with this one any more."""
        worker.kill()
        with self._change:
            self._crew.remove(worker)
            if not self._deserted and not any(member.who for member in self._crew):
                self._deserted = True
                self._waits = 0
            self._change.notify_all()


def cause_of(error: BaseException) -> str:
    """What lies behind an error, in one line."""
    cause = getattr(error, "cause", None)
    found = cause if isinstance(cause, BaseException) else error
    lines = [line.strip() for line in str(found).splitlines() if line.strip()] or ["no message"]
    return f"{type(found).__name__}: {lines[-1]}"[:300]
