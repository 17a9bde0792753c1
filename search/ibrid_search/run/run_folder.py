"""The folder of a run: the names of its files, the files of the best, and its store, made or gone
on with.
"""

import hashlib
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from typing import Any

import tomli_w

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.foreign_data import toml_in
from ibrid.own_files import DATABASE, LIST, adopt
from ibrid.writing import inside, require_folder, write_whole
from ibrid_search.run.store import Store
from ibrid_search.step import USABLE

ARCHIVE, RUN_TOML = DATABASE, "run.toml"
BEST_PROGRAM, BEST_RECORD = "best.py", "best.json"
TRAJECTORY, SELECTION, PAGE = "trajectory.csv", "selection.json", "report.html"
#: What a fleet writes beside its page.
TABLE = "devices.csv"
_WRITTEN = (BEST_PROGRAM, BEST_RECORD, TRAJECTORY, SELECTION, PAGE)
#: Asks the search to stop while it is there.
STOP = "archive.stop"
#: What SQLite and the store keep beside the archive.
BESIDE_ARCHIVE = ("archive.lock", "archive.sqlite-wal", "archive.sqlite-shm")
#: What a new archive would take away, were it there.
TAKEN_AWAY = (*BESIDE_ARCHIVE, "archive.sqlite-journal")


def write_best(folder: Path, record: Record) -> None:
    """best.py and best.json, each replaced atomically."""
    write_whole(inside(folder, BEST_PROGRAM), record.program)
    record.write(inside(folder, BEST_RECORD))


@contextmanager
def open_run(
    folder: Path, options: Mapping[str, Any], texts: Mapping[str, str], resume: bool
) -> Iterator[Store]:
    """The store of a new run, or of the one in the folder when it may be resumed.

    options : of run.toml. texts : what a new store is told beside them. A new run that ends with an
    IbridError before there is a start to search from leaves nothing behind.

    Raises IbridError for a run without `resume`, one with other options, and a folder that cannot
    be used.
    """
    archive, file = inside(folder, ARCHIVE), inside(folder, RUN_TOML)
    exists = archive.exists() or file.exists()
    if not resume:
        require_no_run(folder)
    fresh = not archive.exists() or archive.stat().st_size == 0
    if (
        fresh
        and exists
        and (found := [name for name in (BEST_RECORD, SELECTION) if (folder / name).exists()])
    ):
        raise IbridError(
            f"{folder}: {ARCHIVE} is missing or empty, while {found[0]} of the run lies beside it; "
            "put it back, or choose "
            "another folder"
        )
    if exists:
        if file.exists():  # refused before anything is written
            require_same(read_run_toml(_text_of(file), str(file)), options, str(file))
        adopt_run(folder)
    beside_new = () if exists else TAKEN_AWAY
    # most of them are written at the end of the run, when it is too late to refuse
    require_folder(folder, (*_WRITTEN, *beside_new))
    beside = () if inside(folder, LIST).exists() else (LIST,)
    if not exists:
        make_folder(folder)
        write_whole(file, run_toml(options))
    texts = {
        **texts,
        "settings": run_toml(options),
        "started": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    }
    begun = True
    try:
        with Store.create(archive, texts) if fresh else Store.open(archive) as store:
            _forget_stop(folder)  # it was meant for an earlier sitting
            if exists:
                require_same(
                    read_run_toml(_options_text(file, store), str(file)), options, str(file)
                )
                store.set_meta(
                    "settings", texts["settings"]
                )  # a larger budget, say; run.toml stays as it was made
            try:
                yield store
            except IbridError:
                begun = exists or any(step.status in USABLE for step in store.steps())
                raise
            finally:
                _forget_stop(folder)
    finally:
        if not begun:
            for name in (RUN_TOML, ARCHIVE, *BESIDE_ARCHIVE, STOP, *beside):
                (folder / name).unlink(missing_ok=True)


def _forget_stop(folder: Path) -> None:
    with suppress(OSError, IbridError):  # none was asked for, or it is a link
        inside(folder, STOP).unlink()


def run_meta(folder: Path) -> dict[str, str]:
    """The texts beside the steps in the run's store, the places of its data among them."""
    with Store.open(inside(folder, ARCHIVE), read_only=True) as store:
        return store.meta


def adopt_run(folder: Path) -> None:
    """Take the files of a run that an earlier version made, which left no list of them, for its
    own.
    """
    adopt(folder, (*_WRITTEN, TABLE))


def require_new_run(folder: Path) -> None:
    """IbridError before long work where no new run can be made: one is there, or a file that it
    would write is not its own.
    """
    require_no_run(folder)
    require_folder(folder, (*_WRITTEN, *TAKEN_AWAY))


def require_no_run(folder: Path) -> None:
    """Raise IbridError for a folder that holds a run already."""
    if any(inside(folder, name).exists() for name in (ARCHIVE, RUN_TOML)):
        raise IbridError(
            f"{folder}: holds a run already; go on with it by --resume, or choose another folder"
        )


def require_run(folder: Path) -> None:
    """Raise IbridError unless the folder holds a run to go on with, also one that ended before its
    first step.
    """
    if not any(inside(folder, name).exists() for name in (ARCHIVE, RUN_TOML)):
        missing = "is not a folder" if folder.exists() else "there is no such folder"
        what = "holds no run" if folder.is_dir() else f"{missing}, and so no run"
        raise IbridError(
            f"{folder}: {what} to go on with; name the folder of one, or leave --resume out to "
            "begin"
        )


def make_folder(folder: Path) -> None:
    """Make a folder with those above it, unless it is there; IbridError where that cannot be."""
    if folder.exists() and not folder.is_dir():
        raise IbridError(f"{folder}: is not a folder; choose another place for the run")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise IbridError(
            f"{folder}: cannot be made ({error.strerror}); choose another place for the run"
        ) from None


def _options_text(file: Path, store: Store) -> str:
    """The text of run.toml, or the copy in the store when the file is gone."""
    return _text_of(file) if file.exists() else store.meta.get("settings", "")


def _text_of(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise IbridError(
            f"{file}: must be a text that can be read; restore it, or start a new run"
        ) from None


#: Packages whose versions can change a number.
_PACKAGES = (
    "ibrid",
    "casadi",
    "control",
    "numba",
    "numpy",
    "peft",
    "scipy",
    "torch",
    "transformers",
)
#: Options that may differ when a run is resumed; `settings.wall` is of older runs.
FREE = (
    "budget",
    "target",
    "workers",
    "ray",
    "prices",
    "settings.wall",
    "settings.processor_limit",
    "server.timeout",
)
#: Of options that older runs do not have, what they were made with.
BEFORE = {"settings.effort": "normal"}
_DIGEST = "_sha256"


def run_toml(options: Mapping[str, Any]) -> str:
    """The text of run.toml: options (tables for mappings), then versions."""
    return tomli_w.dumps(_plain({**options, "versions": _versions()}))


def read_run_toml(text: str, where: str) -> dict[str, Any]:
    """The options; IbridError when the text is not TOML."""
    try:
        return toml_in(text)
    except ValueError as error:
        raise IbridError(
            f"{where}: must be TOML, but {error}; restore it, or start a new run"
        ) from None


def require_same(before: Mapping[str, Any], now: Mapping[str, Any], where: str) -> None:
    """Raise IbridError when options that shape the search differ from those of the run; the same
    data may lie elsewhere.
    """
    made = BEFORE | _flat(before)
    wanted = BEFORE | _flat(read_run_toml(run_toml(now), "the options"))
    moved = {
        one
        for one in ("data", "events")
        if made.get(one + _DIGEST) == wanted.get(one + _DIGEST) is not None
    }
    for name in sorted((set(made) | set(wanted)) - {*FREE, *moved}):
        if made.get(name) != wanted.get(name):
            what = f"{name} = {_shown(made.get(name))}, now it is {_shown(wanted.get(name))}"
            if name.endswith(_DIGEST):
                what = f"{name.removesuffix(_DIGEST)} of other content"
            raise IbridError(
                f"{where}: the run was made with {what}; resume with the same, or choose another "
                "folder"
            )


def digest(content: str | bytes) -> str:
    """What stands for a text or a file among the options, under a name that ends in _sha256."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()[
        :32
    ]


def _flat(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options by name, those of a table as "table.name"; without the versions."""
    flat: dict[str, Any] = {}
    for name, value in options.items():
        if isinstance(value, Mapping) and name != "versions":
            flat |= {f"{name}.{key}": inner for key, inner in value.items()}
        elif name != "versions":
            flat[name] = value
    return flat


def _shown(value: Any) -> str:
    return "nothing" if value is None else f"{value!s:.120}"


def _plain(value: Any) -> Any:
    """In the types of TOML; None is left out, and half a surrogate pair (a file name that is no
    text) becomes "?".
    """
    if isinstance(value, Mapping):
        return {
            _plain(str(key)): _plain(inner) for key, inner in value.items() if inner is not None
        }
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return (
        value
        if isinstance(value, bool | int | float)
        else str(value).encode(errors="replace").decode()
    )


def _versions() -> dict[str, str]:
    versions = {"python": python_version()}
    for name in _PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return versions
