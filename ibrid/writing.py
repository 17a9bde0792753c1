"""What is written: columns of text, and result files, which appear whole or not at all, a failure
being one sentence.
"""

import json
import os
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from math import isfinite
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.foreign_text import show_controls, show_controls_within, show_surrogates
from ibrid.interrupts import heed_interrupt
from ibrid.own_files import note_written, open_number, require_own

#: Names and values in the types of JSON.
PlainData = dict[str, Any]


def plain(value: Any) -> Any:
    """The same in the types of JSON: arrays as lists, keys as text, None for a number that is not
    finite.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def require_text(path: str | os.PathLike[str], what: str) -> None:
    """Raise IbridError for a place whose ending says that it holds no text in columns."""
    if Path(path).suffix.lower() not in ("", ".csv", ".txt", ".tsv"):
        raise IbridError(f"{path}: must end with .csv, since {what} is written as text in columns")


def require_place(path: str | Path) -> None:
    """Raise IbridError unless a file can and, by `ibrid.own_files`, may be written at `path`; ask
    before long work.

    Nothing is left behind.
    """
    if not str(path):
        raise IbridError("'': must be a file; give a file name")
    if str(path).endswith(os.sep):
        raise IbridError(f"{path}: is the name of a folder; add a file name")
    path = Path(path)
    if str(path) == "-":
        raise IbridError("-: must be a file, only --json - goes to the terminal; give a file name")
    try:
        if path.is_dir():
            raise IbridError(f"{path}: is a folder; add a file name")
        require_own(path)
        if (number := open_number(path)) is not None:
            os.write(number, b"")  # fails where it was opened to be read
            return
        if path.exists() and not path.is_file():
            return
        if path.exists() and not os.access(path, os.W_OK):
            raise IbridError(f"{path}: is protected against writing; choose another place")
        if _target(path).is_symlink():
            raise IbridError(f"{path}: is a link that leads to itself; choose another place")
        folder = _target(path).parent
        if not folder.exists():
            raise IbridError(
                f"{path}: there is no folder {folder}; make it first or choose another place"
            )
        if not folder.is_dir():
            raise IbridError(f"{path}: {folder} is not a folder; choose another place")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise IbridError(f"{path}: the folder {folder} is not writable; choose another place")
        with tempfile.TemporaryFile(dir=folder):  # some folders, such as /proc, refuse only then
            pass
    except (OSError, ValueError) as error:
        raise _refused(path, error) from None


def require_folder(path: str | Path, names: Iterable[str] = ()) -> None:
    """Raise IbridError unless files can be written in the folder `path`, which is there or can be
    made; ask before long work.

    names : of files that will be. Nothing is left behind: a folder that had to be made is taken
    away again.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_dir():
            raise IbridError(f"{path}: is not a folder; choose another place")
        missing = [one for one in (path, *path.parents) if not one.exists()]
        try:
            path.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=path):
                pass
        finally:
            for one in missing:
                with suppress(OSError):  # not made, or somebody else uses it by now
                    one.rmdir()
    except (OSError, ValueError) as error:
        raise _refused(path, error) from None
    if path.is_dir():
        for name in names:
            require_place(inside(path, name))


def inside(folder: str | Path, name: str) -> Path:
    """A file of ours in a folder that may come from others, to be read or written.

    Raises IbridError where it is a link, a pipe or a device there: what is done in the folder must
    stay in it.
    """
    path = Path(folder) / name
    if path.is_symlink() or (path.exists() and not path.is_file() and not path.is_dir()):
        raise IbridError(
            f"{path}: must be a file of its own, found a link or a device; remove it and try again"
        )
    return path


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write text in UTF-8, controls as escapes, or bytes, replacing a file atomically.

    A device or a pipe such as /dev/null is written to, and so is what the process has open, such as
    /dev/stdout, at its end. Within a command nothing is written that `ibrid.own_files` forbids, nor
    through a link; elsewhere a link keeps pointing where it points. Raises IbridError when the
    place cannot be written.
    """
    heed_interrupt()
    require_place(path)
    path = Path(path)
    data = show_controls(content).encode("utf-8") if isinstance(content, str) else content
    try:
        number = open_number(path)
        if number is not None or (path.exists() and not path.is_file()):
            with open(path if number is None else os.dup(number), "wb", buffering=0) as stream:
                stream.write(data)
            return
        note_written(path, data)
        _replace(_target(path), data)
    except (OSError, ValueError) as error:
        raise _refused(path, error) from None


def json_lines(content: Any) -> str:
    """Plain data as JSON files and the terminal have it, in ASCII; halves of surrogate pairs, which
    no reader takes, escaped.
    """
    text = json.dumps(content, indent=1, allow_nan=False)
    if "\\ud" in text:  # rare: of names of files that are no text
        text = json.dumps(show_controls_within(content, show_surrogates), indent=1, allow_nan=False)
    return text + "\n"


def write_json(path: str | Path, content: Any) -> None:
    """`write_whole` of that."""
    write_whole(path, json_lines(content))


def _target(path: Path) -> Path:
    return Path(os.path.realpath(path))


def _replace(path: Path, data: bytes) -> None:
    mode = path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask()
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".ibrid-", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        os.chmod(temporary, mode)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def _umask() -> int:
    """The process's mask; mkstemp makes private files, a result should be as readable as any
    other.
    """
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _refused(path: Path, error: Exception) -> IbridError:
    why = getattr(error, "strerror", None) or str(error)
    return IbridError(f"{str(path)[:200]}: cannot be written ({why}); choose another place")


def aligned(rows: Iterable[Iterable[str]], indent: str = "") -> str:
    """Left-aligned columns, two spaces apart; the last column may be of any width."""
    cells = [list(row) for row in rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(cells[0]))]
    return "\n".join(
        (
            indent + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    )
