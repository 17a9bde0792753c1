"""Evil programs against the limits of an evaluation: each in a process of its own, its time and memory measured."""

import multiprocessing
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

from ibrid_bench.attack.programs import EVIL

from ibrid.evaluation.evaluate import evaluate
from ibrid.fit.settings import FitSettings
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweep import Sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.library import textbook

#: Limit of each evaluation (s), and how late an answer may be on a busy machine before it counts as lost.
SECONDS, LATE = 5.0, 1.0
#: Memory (MB) that an evaluation may add to a process that has loaded everything.
MEMORY = 200.0
#: In which an illegal program must be refused, s.
REFUSED = 1.0
#: After which a process is killed, s.
PATIENCE = 120.0


@dataclass(frozen=True)
class Attempt:
    """One program: its outcome, seconds of wall and MB of memory that its evaluation took."""

    what: str
    outcome: str
    seconds: float
    megabytes: float

    @property
    def held(self) -> bool:
        """Whether the limits held."""
        most = REFUSED if self.outcome == "invalid" else SECONDS + LATE
        return self.outcome != "broke" and self.seconds <= most and self.megabytes <= MEMORY


def attempts() -> Iterator[Attempt]:
    """All of the table, one after the other; POSIX alone."""
    sweep = read_sweep(benchmarks()["paper_like"])
    evaluate(textbook("naive"), sweep, restarts=0)  # all is loaded before the processes fork
    for what in EVIL:
        yield _attempt(what, sweep)


def _attempt(what: str, sweep: Sweep) -> Attempt:
    processes = multiprocessing.get_context("fork")
    queue = processes.SimpleQueue()
    process = processes.Process(target=lambda: queue.put(_measured(what, sweep)))
    process.start()
    process.join(PATIENCE)
    if process.exitcode != 0:
        process.kill()
        process.join()
        return Attempt(what, "broke", PATIENCE, 0.0)
    return queue.get()


def _measured(what: str, sweep: Sweep) -> Attempt:
    diagram, before, started = EVIL[what](), _megabytes(), time.perf_counter()
    record = evaluate(diagram, sweep, settings=FitSettings(seconds=SECONDS))
    return Attempt(what, str(record.outcome), time.perf_counter() - started, _megabytes() - before)


def _megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
