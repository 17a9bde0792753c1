"""Evaluates jobs on Ray actors: back-pressure, a wall limit that kills, and lost workers that do not count.

One thread of this process waits for each actor and starts the next when it dies; the state that they share is changed
under one condition.
"""

import atexit
import pickle
import threading
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

from ibrid.errors import IbridError
from ibrid.modules.vocabulary import choose_vocabulary
from search.evaluation.assess import Subject
from search.evaluation.job import Job, Result
from search.evaluation.open_jobs import OpenJobs
from search.evaluation.ray_session import open_session
from search.evaluation.turns import Attempt, Turns
from search.evaluation.verdict import Verdict, stopped
from search.evaluation.worker import ONE_THREAD, Worker
from search.step import Status

#: Seconds beyond the wall limit in which an actor may stop by itself before its process is killed.
GRACE = 1.0
#: Seconds without any worker after which the evaluator gives up.
PATIENCE = 300.0


class RayEvaluator:
    """Evaluates on `workers` actors, each with one core, of a local Ray or of the cluster at `address`.

    An actor has one job at a time, so what has not begun waits here and is never lost. `wall` : seconds that a job may
    take; it is then stopped, its process killed where it does not stop by itself, and evaluated once more with nothing
    else running before it counts as TIMEOUT. `lost` : workers that may die on a job before it counts as LOST.
    `patience` : seconds without any worker after which `collect` gives up.

    Raises IbridError when Ray is missing, does not start or does not answer, or the subject cannot travel.
    """

    def __init__(
        self,
        subject: Subject,
        workers: int,
        *,
        address: str | None = None,
        wall: float = 60.0,
        lost: int = 3,
        patience: float = PATIENCE,
    ):
        if workers < 1 or lost < 1 or not wall > 0:
            raise IbridError(
                f"workers and lost must be 1 or more and wall above 0 s, found {workers}, {lost} and {wall:g} s"
            )
        self.subject = subject
        self.capacity = workers
        self.wall = wall
        self.lost = lost
        self._patience = patience
        self._session = open_session(workers, address)
        self._ray = self._session.ray
        try:
            self._cargo = self._ray.put(_pickled(self._ray, subject))
        except BaseException:
            self._session.close()
            raise
        self._actor = self._ray.remote(
            num_cpus=1, max_restarts=0, max_task_retries=0, runtime_env={"env_vars": ONE_THREAD}
        )(Worker)
        self._change = threading.Condition()
        self._jobs = OpenJobs()
        self._turns = Turns()
        self._closed = False
        self._serving = workers  # threads that can still get an actor
        self._why = "the evaluator lost all its workers; resume the search"  # said when there are none
        self._crew: dict[Any, str] = {}  # actors that started, and who they are; "" until they are ready
        self._deserted: float | None = time.monotonic()  # since when no actor is ready
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(workers)]
        for thread in self._threads:
            thread.start()
        atexit.register(self.close)  # before Ray's own end, which threads that still wait would disturb

    @property
    def waiting(self) -> tuple[int, ...]:
        """Numbers submitted and not collected, in the order of their submission."""
        with self._change:
            return self._jobs.numbers

    @property
    def running(self) -> frozenset[int]:
        """Numbers of the jobs that actors work on now, at most `capacity`."""
        with self._change:
            return self._turns.running

    @property
    def workers(self) -> tuple[str, ...]:
        """The actors that are ready, as "host pid N"."""
        with self._change:
            return tuple(who for who in self._crew.values() if who)

    def submit(self, job: Job) -> None:
        """Queue a job; returns at once. IbridError when its number waits already."""
        with self._change:
            self._jobs.add(job)
            self._turns.add(Attempt(job))
            self._change.notify_all()

    def collect(self, number: int) -> Result:
        """The result of that job, once; blocks until it is there.

        Raises IbridError when no such job waits, or when there are no workers and none comes.
        """
        with self._change:
            while True:
                self._jobs.require(number)
                if self._jobs.has_result(number):
                    return self._jobs.take(number)
                if not self._serving:
                    raise IbridError(self._why)
                self._change.wait(self._time_left())

    def close(self) -> None:
        """Kill the actors and end what was started for them; again does nothing."""
        with self._change:
            if self._closed:
                return
            self._closed = True
            self._jobs.close()
            actors = list(self._crew)
            self._change.notify_all()
        for actor in actors:
            self._kill(actor)
        for thread in self._threads:
            thread.join(timeout=10)
        self._session.close()
        atexit.unregister(self.close)

    def __enter__(self) -> "RayEvaluator":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _time_left(self) -> float | None:
        """Seconds until patience ends, None while there are workers."""
        if self._deserted is None:
            return None
        left = self._deserted + self._patience - time.monotonic()
        if left <= 0:
            raise IbridError(
                f"no worker was ready for {self._patience:g} s; ray status shows whether the cluster has a free core, "
                "then resume the search"
            )
        return left

    def _serve(self) -> None:
        """The life of a thread: an actor after the other, and with each a job after the other."""
        try:
            while (actor := self._ready_actor()) is not None:
                while (attempt := self._next_attempt()) is not None:
                    if not self._try(actor, attempt):
                        break
                self._dismiss(actor)
        finally:
            with self._change:
                self._serving -= 1
                self._change.notify_all()

    def _ready_actor(self) -> Any:
        """A new actor that has loaded everything; None when closed, or when actors cannot be had."""
        error: Exception | None = None
        for _ in range(self.lost):
            with self._change:
                if self._closed:
                    return None
                actor = self._actor.remote([self._cargo], self.wall)
                self._crew[actor] = ""
            try:
                who = self._ray.get(actor.prepare.remote())
            except self._ray.exceptions.RayTaskError as found:
                self._dismiss(actor)
                self._why = f"a worker could not load the data and the kinds ({_cause(found)}); {_KINDS_ADVICE}"
                return None
            except self._ray.exceptions.RayError as found:
                self._dismiss(actor)
                error = found
                continue
            with self._change:
                self._crew[actor] = who
                self._deserted = None
                self._change.notify_all()
            return actor
        self._why = f"{self.lost} workers in a row died while they started ({_cause(error)}); see the logs of Ray"
        return None

    def _next_attempt(self) -> Attempt | None:
        """Waits for a turn; None when closed."""
        with self._change:
            while not self._closed:
                if (attempt := self._turns.begin()) is not None:
                    return attempt
                self._change.wait()
        return None

    def _try(self, actor: Any, attempt: Attempt) -> bool:
        """Evaluate on the actor and settle or queue again; False when the actor is gone."""
        exceptions = self._ray.exceptions
        started = time.perf_counter()
        alive, after = False, attempt
        try:
            verdict = self._ray.get(actor.evaluate.remote(attempt.job), timeout=self.wall + GRACE)
            alive = True
        except exceptions.GetTimeoutError:
            verdict = stopped(self.wall)
            self._kill(actor)
        except exceptions.RayTaskError as error:
            verdict = Verdict(Status.FAILED, reason=f"the evaluation broke off with {_cause(error)}")
            alive = True
        except exceptions.RayError as error:
            verdict = Verdict(Status.LOST, reason=f"{self.lost} workers died on it, the last with {_cause(error)}")
            after = replace(attempt, losses=attempt.losses + 1)
        if verdict.outcome is Status.TIMEOUT:
            after = replace(attempt, stops=attempt.stops + 1)
        after = replace(after, seconds=attempt.seconds + time.perf_counter() - started)
        again = (verdict.outcome is Status.TIMEOUT and after.stops < 2) or (
            verdict.outcome is Status.LOST and after.losses < self.lost
        )
        with self._change:
            self._turns.end(attempt)
            if again:
                self._turns.add(after)
            else:
                self._jobs.settle(self._result(attempt, after, verdict, self._crew.get(actor, "")))
            self._change.notify_all()
        return alive

    def _result(self, attempt: Attempt, after: Attempt, verdict: Verdict, who: str) -> Result:
        record = verdict.record
        if record is not None:
            record = replace(record, vocabulary=choose_vocabulary(self.subject.kinds))
        return Result(attempt.job.number, verdict.outcome, record, verdict.reason, after.seconds, attempt.number, who)

    def _dismiss(self, actor: Any) -> None:
        """The actor is not used any more."""
        self._kill(actor)
        with self._change:
            self._crew.pop(actor, None)
            if not any(self._crew.values()) and self._deserted is None:
                self._deserted = time.monotonic()
            self._change.notify_all()

    def _kill(self, actor: Any) -> None:
        """End the actor's process, whatever it is doing."""
        with suppress(self._ray.exceptions.RayError, ValueError, RuntimeError):  # gone already
            self._ray.kill(actor, no_restart=True)


_KINDS_ADVICE = "write kinds of your own in the notebook or script of the search, or install their module on every node"


def _pickled(ray: Any, subject: Subject) -> bytes:
    """The subject as bytes, functions of a notebook included."""
    try:
        return ray.cloudpickle.dumps(subject)
    except (TypeError, ValueError, AttributeError, pickle.PicklingError) as error:
        raise IbridError(
            f"the data and kinds must be picklable to travel to workers, found {_cause(error)}; state_space of a kind "
            "should use its arguments alone"
        ) from None


def _cause(error: BaseException | None) -> str:
    """What lies behind an error, in one line."""
    cause = getattr(error, "cause", None)
    found = cause if isinstance(cause, BaseException) else error
    lines = [line.strip() for line in str(found).splitlines() if line.strip()] or ["no message"]
    return f"{type(found).__name__}: {lines[-1]}"[:300]
