"""The logbook of a sitting: in memory alone, or in a folder where the next sitting on the same data goes on."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.measurement.csv_file import sweep_csv
from ibrid.writing import write_whole
from search.logbook import Effort, Logbook
from search.proposal import Task
from search.run_file import read_run_toml, require_same, run_toml
from search.step import Status
from search.store import Store

_STOPPED = "the server was stopped before the evaluation ended; submit the program again"


@contextmanager
def open_logbook(task: Task, effort: Effort, folder: Path | None, start: str) -> Iterator[Logbook]:
    """A logbook; with a folder, its store is made or, for the same data, start and options, gone on with.

    Raises IbridError when the folder holds another run or cannot be used.
    """
    if folder is None:
        yield Logbook(task, effort=effort)
        return
    options = {
        "proposer": "tools",
        "parameters": task.parameters,
        "equilibrium": task.equilibrium,
        "kinds": [kind.name for kind in task.kinds],
        "seed": effort.seed,
        "holdout_op": list(effort.holdout_op),
    }
    texts = {"data": sweep_csv(task.sweep), "start": start, "truth": ""}
    with _store(Path(folder), texts, options) as store:
        for step in store.pending():
            store.conclude(step.number, status=Status.LOST, reason=_STOPPED)
        yield Logbook(task, effort=effort, store=store, folder=Path(folder), steps=tuple(store.steps()))


def _store(folder: Path, texts: dict[str, str], options: dict[str, Any]) -> Store:
    path = folder / "archive.sqlite"
    if not path.exists():
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise IbridError(f"{folder}: cannot be made ({error.strerror}); choose another place") from None
        settings = run_toml(options)
        write_whole(folder / "run.toml", settings)
        started = datetime.now(UTC).isoformat(timespec="seconds")
        return Store.create(path, {**texts, "settings": settings, "started": started})
    store = Store.open(path)
    try:
        require_same(read_run_toml(store.meta.get("settings", ""), str(path)), options, str(folder))
        for name, what in (("data", "other data"), ("start", "another start")):
            if store.meta.get(name) != texts[name]:
                raise IbridError(f"{folder}: holds a run with {what}; choose another folder")
    except IbridError:
        store.close()
        raise
    return store
