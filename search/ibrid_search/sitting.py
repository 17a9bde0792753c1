"""The logbook of a sitting: in memory alone, or in a folder where the next sitting on the same data goes on."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ibrid.measurement.csv_file import sweep_csv
from ibrid_search.logbook import Effort, Logbook
from ibrid_search.proposal import Task
from ibrid_search.run_file import digest
from ibrid_search.run_folder import open_run
from ibrid_search.step import Status

_STOPPED = "the server was stopped before the evaluation ended; submit the program again"


@contextmanager
def open_logbook(task: Task, effort: Effort, folder: Path | None, start: str) -> Iterator[Logbook]:
    """A logbook; with a folder, its store is made or, for the same data, start and options, gone on with.

    Raises IbridError when the folder holds another run or cannot be used.
    """
    if folder is None:
        yield Logbook(task, effort=effort)
        return
    texts = {"data": sweep_csv(task.sweep), "start": start, "truth": ""}
    options = {
        "proposer": "tools",
        "parameters": task.parameters,
        "equilibrium": task.equilibrium,
        "kinds": [kind.name for kind in task.kinds],
        "seed": effort.seed,
        "holdout_op": list(effort.holdout_op),
        "data_sha256": digest(texts["data"]),
        "start_sha256": digest(start),
    }
    with open_run(folder, options, texts, resume=True) as store:
        for step in store.pending():
            store.conclude(step.number, status=Status.LOST, reason=_STOPPED)
        yield Logbook(task, effort=effort, store=store, folder=folder, steps=tuple(store.steps()))
