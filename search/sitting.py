"""The logbook of a sitting: in memory alone, or in a folder where the next sitting on the same data goes on."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from ibrid import __version__
from ibrid.errors import IbridError
from ibrid.measurement.csv_file import write_sweep
from ibrid.measurement.sweep import Sweep
from ibrid.writing import write_whole
from search.logbook import Effort, Logbook
from search.proposal import Task
from search.step import Status
from search.store import Store

_STOPPED = "the server was stopped before the evaluation ended; submit the program again"


@contextmanager
def open_logbook(task: Task, effort: Effort, folder: Path | None, start: str) -> Iterator[Logbook]:
    """A logbook; with a folder, its store is made or, for the same data, start and settings, gone on with.

    Raises IbridError when the folder holds another run or cannot be used.
    """
    if folder is None:
        yield Logbook(task, effort=effort)
        return
    meta = {"data": sweep_text(task.sweep), "start": start, "truth": "", "settings": _settings(task, effort)}
    with _store(Path(folder), meta) as store:
        for step in store.pending():
            store.conclude(step.number, status=Status.LOST, reason=_STOPPED)
        yield Logbook(task, effort=effort, store=store, folder=Path(folder), steps=tuple(store.steps()))


def sweep_text(sweep: Sweep) -> str:
    """The sweep as the text of a CSV file."""
    with tempfile.TemporaryDirectory(prefix="ibrid-") as place:
        path = Path(place) / "data.csv"
        write_sweep(sweep, path)
        return path.read_text(encoding="utf-8")


def _store(folder: Path, meta: dict[str, str]) -> Store:
    path = folder / "archive.sqlite"
    if not path.exists():
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise IbridError(f"{folder}: cannot be made ({error.strerror}); choose another place") from None
        write_whole(folder / "run.toml", f'ibrid = "{__version__}"\n' + meta["settings"])
        return Store.create(path, meta | {"started": datetime.now(UTC).isoformat(timespec="seconds")})
    store = Store.open(path)
    for name, what in (("data", "other data"), ("start", "another start"), ("settings", "other settings")):
        if store.meta.get(name) != meta[name]:
            store.close()
            raise IbridError(
                f"{folder}: holds a run with {what}; choose another folder, or the options it was made with"
            )
    return store


def _settings(task: Task, effort: Effort) -> str:
    kinds = ", ".join(f'"{kind.name}"' for kind in task.kinds)
    held = ", ".join(f'"{name}"' for name in effort.holdout_op)
    return (
        'proposer = "tools"\n'
        f'parameters = "{task.parameters}"\nequilibrium = "{task.equilibrium}"\nkinds = [{kinds}]\n'
        f"seed = {effort.seed}\nholdout_op = [{held}]\n"
    )
