"""The folder of a run: the names of its files, the files of the best, and its store, made or gone on with."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.writing import inside, write_whole
from ibrid_search.run_file import read_run_toml, require_same, run_toml
from ibrid_search.step import USABLE
from ibrid_search.store import Store

ARCHIVE, RUN_TOML = "archive.sqlite", "run.toml"
BEST_PROGRAM, BEST_RECORD = "best.py", "best.json"
TRAJECTORY, SELECTION, PAGE = "trajectory.csv", "selection.json", "report.html"
_WRITTEN = (BEST_PROGRAM, BEST_RECORD, TRAJECTORY, SELECTION, PAGE)
#: What SQLite and the store keep beside the archive.
BESIDE_ARCHIVE = ("archive.lock", "archive.sqlite-wal", "archive.sqlite-shm")


def write_best(folder: Path, record: Record) -> None:
    """best.py and best.json, each replaced atomically."""
    write_whole(inside(folder, BEST_PROGRAM), record.program)
    record.write(inside(folder, BEST_RECORD))


@contextmanager
def open_run(folder: Path, options: Mapping[str, Any], texts: Mapping[str, str], resume: bool) -> Iterator[Store]:
    """The store of a new run, or of the one in the folder when it may be resumed.

    options : of run.toml. texts : what a new store is told beside them. A new run that ends with an IbridError before
    there is a start to search from leaves nothing behind.

    Raises IbridError for a run without `resume`, one with other options, and a folder that cannot be used.
    """
    archive, file = inside(folder, ARCHIVE), inside(folder, RUN_TOML)
    for name in _WRITTEN:  # at the end of the run, when it is too late to refuse
        inside(folder, name)
    exists = archive.exists() or file.exists()
    if exists and not resume:
        raise IbridError(f"{folder}: holds a run already; go on with it by --resume, or choose another folder")
    if not exists:
        make_folder(folder)
        _require_own_names(folder)
        write_whole(file, run_toml(options))
    texts = {**texts, "settings": run_toml(options), "started": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
    fresh = not archive.exists() or archive.stat().st_size == 0
    begun = True
    try:
        with Store.create(archive, texts) if fresh else Store.open(archive) as store:
            if exists:
                require_same(read_run_toml(_options_text(file, store), str(file)), options, str(file))
                store.set_meta("settings", texts["settings"])  # a larger budget, say; run.toml stays as it was made
            try:
                yield store
            except IbridError:
                begun = exists or any(step.status in USABLE for step in store.steps())
                raise
    finally:
        if not begun:
            for name in (RUN_TOML, ARCHIVE, *BESIDE_ARCHIVE):
                (folder / name).unlink(missing_ok=True)


def require_run(folder: Path) -> None:
    """Raise IbridError unless the folder holds a run to go on with, also one that ended before its first step."""
    if not any(inside(folder, name).exists() for name in (ARCHIVE, RUN_TOML)):
        missing = "is not a folder" if folder.exists() else "there is no such folder"
        what = "holds no run" if folder.is_dir() else f"{missing}, and so no run"
        raise IbridError(f"{folder}: {what} to go on with; name the folder of one, or leave --resume out to begin")


def make_folder(folder: Path) -> None:
    """Make a folder with those above it, unless it is there; IbridError where that cannot be."""
    if folder.exists() and not folder.is_dir():
        raise IbridError(f"{folder}: is not a folder; choose another place for the run")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise IbridError(f"{folder}: cannot be made ({error.strerror}); choose another place for the run") from None


def _require_own_names(folder: Path) -> None:
    for name in _WRITTEN:
        if inside(folder, name).exists():
            raise IbridError(f"{folder}: holds {name}, which the run would overwrite; choose another folder")


def _options_text(file: Path, store: Store) -> str:
    """The text of run.toml, or the copy in the store when the file is gone."""
    try:
        return file.read_text(encoding="utf-8")
    except FileNotFoundError:
        return store.meta.get("settings", "")
    except (OSError, UnicodeDecodeError):
        raise IbridError(f"{file}: must be a text that can be read; restore it, or start a new run") from None
