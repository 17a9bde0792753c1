"""Evaluates jobs in processes of this machine, without Ray: what crashes, hangs or fills the memory
takes one job with it.
"""

import os
import pickle
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection, Pipe

import cloudpickle

from ibrid.errors import IbridError
from ibrid.fit import kernel
from ibrid.hanging import LOOK, PROCESSOR_LIMIT, STILL, HangWatch, processor_seconds
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
from ibrid_search.evaluation.verdict import Assessing, Verdict, ended, judge, without_vocabulary
from ibrid_search.step import Status

#: What a worker runs before it imports anything, which takes longest where many share the cores.
_END_WITH_THE_PARENT = (
    "import os, sys, threading; threading.Thread(target=lambda: "
    "(sys.stdin.buffer.read(), os._exit(0)), daemon=True).start()"
)


class ProcessEvaluator(CrewEvaluator[Assessor]):
    """A `CrewEvaluator` of processes of this machine, which end with the one that began them,
    however that ends; at most two for each core, since more would wait for one another.

    Raises IbridError when the assessor cannot travel.
    """

    def __init__(
        self,
        assessor: Assessor,
        workers: int,
        *,
        processor_limit: float = PROCESSOR_LIMIT,
        still: int = STILL,
        lost: int = 3,
        patience: int = PATIENCE,
    ):
        if os.name != "posix":
            raise IbridError(
                "worker processes need Linux or macOS; give a Ray cluster by --ray instead"
            )
        try:
            cargo = cloudpickle.dumps(
                assessor
            )  # kinds that a notebook or a script defines travel by value
        except (TypeError, ValueError, AttributeError, pickle.PicklingError) as error:
            raise IbridError(NOT_PICKLABLE.format(cause_of(error))) from None
        hire = partial(_Process, cargo, processor_limit, still)
        workers = min(workers, 2 * (os.cpu_count() or 1))
        super().__init__(assessor, workers, hire, lost=lost, patience=patience)


class _Process:
    """A `CrewMember` that is a process; it is ended where it hangs (`ibrid.hanging`)."""

    def __init__(self, cargo: bytes, processor_limit: float, still: int) -> None:
        self.who, self.alive = "", True
        self._processor_limit, self._still = processor_limit, still
        self._cargo = cargo
        self._channel, theirs = Pipe()
        command = f"{_END_WITH_THE_PARENT}; from {__name__} import serve; serve({theirs.fileno()})"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", command],
            stdin=subprocess.PIPE,  # ends with this process
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            pass_fds=[theirs.fileno()],
            process_group=0,  # Ctrl-C in the terminal is for the search alone
        )
        theirs.close()

    def prepare(self) -> None:
        with self._or_lost():
            self._channel.send_bytes(self._cargo)
            name, why = self._channel.recv()
        if why:
            self.kill()
            raise IbridError(NOT_LOADED.format(why))
        self.who = name

    def evaluate(self, job: Job) -> Verdict:
        try:
            asked = cloudpickle.dumps(job)
        except Exception as error:
            return _cannot_travel(error)
        with self._or_lost():
            self._channel.send_bytes(asked)
            watch = HangWatch(
                partial(processor_seconds, self._process.pid), self._processor_limit, self._still
            )
            while not self._channel.poll(LOOK):
                if why := watch.why_it_hangs():
                    self.kill()
                    return ended(why)
            return pickle.loads(self._channel.recv_bytes())

    def kill(self) -> None:
        self.alive = False
        self._process.kill()
        self._process.wait()
        with suppress(OSError):
            self._channel.close()

    @contextmanager
    def _or_lost(self) -> Iterator[None]:
        """A channel that breaks in the block means that the worker is gone."""
        try:
            yield
        except (EOFError, OSError):
            self.kill()
            raise WorkerLost(f"{self.who or 'a process that started'}: it ended") from None


def serve(handle: int) -> None:
    """The life of a worker process: the assessor, then a job after the other, until its parent is
    gone. Whatever loading a user's own kinds raises is told.
    """
    channel = Connection(handle)
    assessor: Assessing
    try:
        assessor = pickle.loads(channel.recv_bytes()).arrived()
        kernel.load()
    except Exception as error:
        channel.send(("", cause_of(error)))
        os._exit(1)
    channel.send((f"{socket.gethostname()} pid {os.getpid()}", ""))
    with suppress(EOFError, OSError):
        while True:
            verdict = without_vocabulary(judge(pickle.loads(channel.recv_bytes()), assessor))
            try:
                answer = cloudpickle.dumps(verdict)
            except Exception as error:
                answer = pickle.dumps(_cannot_travel(error))
            channel.send_bytes(answer)
    os._exit(0)


def _cannot_travel(error: Exception) -> Verdict:
    return Verdict(Status.FAILED, reason=f"the evaluation broke off with {cause_of(error)}")
