"""Evil programs against the bounds of the grammar: each in a process of its own, its processor time
and memory measured.
"""

import multiprocessing
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

from ibrid_bench.attack.programs import EVIL

from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.library import textbook

#: Processor seconds that the costliest legal program may take: what bounds it are the grammar and
#: the counts of a fit.
SECONDS = 240.0
#: Memory (MB) that an evaluation may add to a process that has loaded everything.
MEMORY = 200.0
#: In which an illegal program must be refused, s.
REFUSED = 2.0
#: After which a process is killed, s.
PATIENCE = 3600.0


@dataclass(frozen=True)
class Attempt:
    """One program: its outcome, processor seconds and MB of memory that its evaluation took."""

    what: str
    outcome: str
    seconds: float
    megabytes: float

    @property
    def held(self) -> bool:
        """Whether the limits held."""
        most = REFUSED if self.outcome == "invalid" else SECONDS
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
    diagram, before, started = EVIL[what](), _megabytes(), time.process_time()
    record = evaluate(diagram, sweep)
    return Attempt(what, str(record.outcome), time.process_time() - started, _megabytes() - before)


def _megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        1e6 if sys.platform == "darwin" else 1e3
    )
