"""The actor that evaluates: a process of its own that holds the assessor and does one job at a time."""

import os
import pickle
import signal
import socket
from dataclasses import replace

from ibrid.fit import kernel
from ibrid_search.evaluation.assess import Assessor
from ibrid_search.evaluation.job import Job
from ibrid_search.evaluation.verdict import Verdict, judge

#: One thread of computation per actor, so that as many actors as cores do not get in each other's way.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


class Worker:
    """What `ray.remote` makes an actor of.

    `box` : a list with the reference of the pickled assessor, so that loading it happens in `prepare` and can be reported.
    `wall` : limit per job in s.
    """

    def __init__(self, box: list, wall: float):
        self._box = box
        self._wall = wall
        self._assessor: Assessor | None = None

    def prepare(self) -> str:
        """Load the assessor and the compiled code; who this is. Whatever loading a user's own kinds raises passes."""
        import ray

        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C in the terminal of the search is for the search alone
        assessor: Assessor = pickle.loads(ray.get(self._box[0]))
        # pickled arrays come back writeable, for which the kernel would have to be compiled once more
        study = assessor.study
        frozen = replace(study.sweep, points=tuple(replace(point) for point in study.sweep.points))
        self._assessor = replace(assessor, study=replace(study, sweep=frozen))
        kernel.load()
        return f"{socket.gethostname()} pid {os.getpid()}"

    def evaluate(self, job: Job) -> Verdict:
        """The verdict; the record without its vocabulary, which the search has."""
        assert self._assessor is not None
        verdict = judge(job, self._assessor, self._wall)
        if verdict.record is None:
            return verdict
        return replace(verdict, record=replace(verdict.record, vocabulary=()))
