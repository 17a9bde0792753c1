"""The devices of a fleet: files of a folder, in the order of their names, each a step of the
store.
"""

from collections.abc import Iterator
from os.path import realpath
from pathlib import Path

from ibrid.errors import IbridError
from ibrid.measurement.formats.files import read_bytes
from ibrid_search.run.run_folder import digest
from ibrid_search.run.store import Store
from ibrid_search.step import OPEN_AGAIN, Step


def files_of(folder: Path, out: Path) -> list[str]:
    """Names of all files in a folder and those below it, but for hidden ones and those of the
    fleet's own folder.

    Raises IbridError where there is none, and where both are one folder: answers would lie among
    the measurements.
    """
    if not folder.is_dir():
        raise IbridError(
            f"{folder}: must be a folder with a sweep file for each device; there is no such folder"
        )
    own = out.resolve()
    if own == folder.resolve():
        raise IbridError(
            f"{out}: must be a folder of the fleet's own, found the one with the measurements; "
            "name another"
        )
    found = sorted(_below(folder, own), key=lambda path: path.relative_to(folder).parts)
    if not found:
        raise IbridError(f"{folder}: must hold a sweep file for each device; it holds no file")
    return [path.relative_to(folder).as_posix() for path in found]


def _below(folder: Path, own: Path) -> Iterator[Path]:
    for path in folder.iterdir():
        if path.name.startswith(".") or Path(realpath(path)) == own:
            continue
        if path.is_dir() and not path.is_symlink():
            yield from _below(path, own)
        # a link to a folder too, which may lead in circles: its line of the table says that it is
        # no file
        else:
            yield path


def enlist(store: Store, folder: Path, names: list[str], job: str) -> list[Step]:
    """The devices of the store, those that are new in the folder behind the others, those whose
    workers died waiting again.
    """
    steps = []
    for step in store.steps():
        if step.status in OPEN_AGAIN:
            store.reopen(step.number)
            step = store.step(step.number)
        steps.append(step)
    known = {step.note for step in steps}
    for name in names:
        if name not in known:
            step = Step(number=len(steps), note=name, proposer=job, hash=_print_of(folder / name))
            store.propose(step)
            steps.append(step)
    return steps


def content_of(folder: Path, step: Step) -> bytes:
    """What is in the file of a device; IbridError, one sentence, where it cannot be read or is
    another than at the beginning.
    """
    content = read_bytes(folder / step.note)
    if digest(content) != step.hash:
        raise IbridError(
            f"{step.note}: changed since the fleet began; put the file back, or begin another fleet"
        )
    return content


def _print_of(file: Path) -> str:
    """What stands for the content; "" where it cannot be read, which the device's turn will
    tell.
    """
    try:
        return digest(read_bytes(file))
    except IbridError:
        return ""
