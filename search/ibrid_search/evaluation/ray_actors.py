"""Evaluates jobs on Ray actors, of a local Ray or of a cluster."""

import os
import pickle
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from ibrid.errors import IbridError
from ibrid.fit import kernel
from ibrid.hanging import PROCESSOR_LIMIT, HangWatch, processor_seconds
from ibrid_search.evaluation.crew import (
    NOT_LOADED,
    NOT_PICKLABLE,
    ONE_THREAD,
    PATIENCE,
    Assessor,
    CrewEvaluator,
    WorkerLost,
    cause_of,
)
from ibrid_search.evaluation.job import Job
from ibrid_search.evaluation.ray_session import open_session
from ibrid_search.evaluation.verdict import Assessing, Verdict, ended, judge, without_vocabulary
from ibrid_search.step import Status

#: Seconds between two looks at an actor, which may run on another machine, and looks in a row after
#: which one that does nothing hangs.
LOOK, STILL = 10.0, 60


class RayEvaluator(CrewEvaluator[Assessor]):
    """A `CrewEvaluator` of actors, each with one core, of a local Ray or of the cluster at
    `address`.

    Raises IbridError when Ray is missing, does not start or does not answer, or the assessor cannot
    travel.
    """

    def __init__(
        self,
        assessor: Assessor,
        workers: int,
        *,
        address: str | None = None,
        processor_limit: float = PROCESSOR_LIMIT,
        look: float = LOOK,
        still: int = STILL,
        lost: int = 3,
        patience: int = PATIENCE,
    ):
        if workers < 1 or lost < 1 or not processor_limit > 0:
            raise IbridError(
                "workers and lost must be 1 or more and processor_limit above 0 s, found "
                f"{workers}, {lost} and "
                f"{processor_limit:g} s"
            )
        self._session = open_session(workers, address)
        try:
            hire = _hiring(self._session.ray, assessor, (processor_limit, look, still))
        except BaseException:
            self._session.close()
            raise
        super().__init__(
            assessor, workers, hire, lost=lost, patience=patience, leave=self._session.close
        )


class _Actor:
    """A `CrewMember` that is an actor.

    `net` : processor seconds of a job, seconds between looks, and idle ones in a row.
    """

    def __init__(self, ray: Any, actor: Any, net: tuple[float, float, int]):
        self.who, self.alive = "", True
        self._ray, self._actor, self._net = ray, actor, net
        self._pid, self._node = 0, ""

    def prepare(self) -> None:
        errors = self._ray.exceptions
        try:
            self.who, self._pid, self._node = self._ray.get(self._actor.prepare.remote())
        except errors.RayTaskError as error:
            raise IbridError(NOT_LOADED.format(cause_of(error))) from None
        except errors.RayError as error:
            raise WorkerLost(cause_of(error)) from None

    def evaluate(self, job: Job) -> Verdict:
        errors = self._ray.exceptions
        try:
            return self._watched(self._actor.evaluate.remote(job))
        except (
            errors.RayTaskError,
            TypeError,
            pickle.PicklingError,
        ) as error:  # a job or record that cannot travel
            return Verdict(Status.FAILED, reason=f"the evaluation broke off with {cause_of(error)}")
        except errors.RayError as error:
            self.kill()  # an actor that cannot be reached may still be there
            raise WorkerLost(cause_of(error)) from None

    def _watched(self, answer: Any) -> Verdict:
        """The answer, once it is there; UNFINISHED where the actor hangs."""
        limit, look, still = self._net
        watch: HangWatch | None = None
        while True:
            with suppress(self._ray.exceptions.GetTimeoutError):
                return self._ray.get(answer, timeout=look)
            if watch is None:  # most jobs end before the first look
                watch = HangWatch(self._processor_seconds, limit, still, look)
            elif why := watch.why_it_hangs():
                self.kill()
                return ended(why)

    def _processor_seconds(self) -> float:
        """Of the actor's process, asked on its node; 0 where nobody answers there."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        there = NodeAffinitySchedulingStrategy(self._node, soft=False)
        asked = self._ray.remote(num_cpus=0, scheduling_strategy=there)(processor_seconds).remote(
            self._pid
        )
        with suppress(self._ray.exceptions.RayError):
            return self._ray.get(asked, timeout=10.0)
        return 0.0

    def kill(self) -> None:
        self.alive = False
        with suppress(self._ray.exceptions.RayError, ValueError, RuntimeError):  # gone already
            self._ray.kill(self._actor, no_restart=True)


def _hiring(ray: Any, assessor: Assessing, net: tuple[float, float, int]) -> Callable[[], _Actor]:
    """What starts actors that all have the same assessor, which is stored in the cluster once,
    functions of a notebook included.
    """
    try:
        pickled = ray.cloudpickle.dumps(assessor)
    except (TypeError, ValueError, AttributeError, pickle.PicklingError) as error:
        raise IbridError(NOT_PICKLABLE.format(cause_of(error))) from None
    cargo = ray.put(pickled)
    kind = ray.remote(
        num_cpus=1, max_restarts=0, max_task_retries=0, runtime_env={"env_vars": ONE_THREAD}
    )(Worker)
    return lambda: _Actor(ray, kind.remote([cargo]), net)


class Worker:
    """What `ray.remote` makes an actor of.

    `box` : a list with the reference of the pickled assessor, so that loading it happens in
    `prepare` and can be reported.
    """

    def __init__(self, box: list):
        self._box = box
        self._assessor: Assessing | None = None

    def prepare(self) -> tuple[str, int, str]:
        """Load the assessor and the compiled code; who this is, its process and its node.

        Whatever loading a user's own kinds raises passes.
        """
        import ray

        signal.signal(
            signal.SIGINT, signal.SIG_IGN
        )  # Ctrl-C in the terminal of the search is for the search alone
        self._assessor = pickle.loads(ray.get(self._box[0])).arrived()
        kernel.load()
        return (
            f"{socket.gethostname()} pid {os.getpid()}",
            os.getpid(),
            ray.get_runtime_context().get_node_id(),
        )

    def evaluate(self, job: Job) -> Verdict:
        """The verdict; the record without its vocabulary, which the search has."""
        assert self._assessor is not None
        return without_vocabulary(judge(job, self._assessor))
