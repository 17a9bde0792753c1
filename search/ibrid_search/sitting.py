"""The logbook of a sitting: in memory alone, or in a folder where the next sitting on the same data goes on."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ibrid.fit.settings import FitSettings
from ibrid.measurement.csv_file import sweep_csv
from ibrid.study import Study
from ibrid_search.logbook import Logbook
from ibrid_search.run_file import digest
from ibrid_search.run_folder import open_run
from ibrid_search.step import Status

_STOPPED = "the server was stopped before the evaluation ended; submit the program again"


@contextmanager
def open_logbook(study: Study, fit: FitSettings, folder: Path | None, start: str) -> Iterator[Logbook]:
    """A logbook; with a folder, its store is made or, for the same data, start and options, gone on with.

    Raises IbridError when the folder holds another run or cannot be used.
    """
    if folder is None:
        yield Logbook(study, fit=fit)
        return
    texts = {"data": sweep_csv(study.sweep), "start": start, "truth": ""}
    options = {
        "proposer": "tools",
        "parameters": study.parameters,
        "equilibrium": study.equilibrium,
        "kinds": [kind.name for kind in study.kinds],
        "seed": study.seed,
        "holdout_op": list(study.held),
        "data_sha256": digest(texts["data"]),
        "start_sha256": digest(start),
    }
    with open_run(folder, options, texts, resume=True) as store:
        for step in store.pending():
            store.conclude(step.number, status=Status.LOST, reason=_STOPPED)
        yield Logbook(study, fit=fit, store=store, folder=folder, steps=tuple(store.steps()))
