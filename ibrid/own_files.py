"""Which files a command may write into a folder: never an input, nothing through a link, and none
that it did not write itself.

A file that the user calls by its own name (`--json fit.json`) is meant, and is replaced unless it
is an input, a link, or lies in a folder that the command reads or writes, or in a run's.

What commands have written into a folder stands in a list there, `.ibrid-files`, a JSON a line: the
file, the SHA-256 of its content and the command. A file whose content is not in the list was edited
since. Lines are only added, so that several commands may write into one folder at a time; a line is
there before its file, so that one that is stopped between leaves no file unknown.
"""

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path

from ibrid.errors import IbridError

LIST = ".ibrid-files"
#: Bytes of a list that are read at most; no folder of ours has a thousandth of it.
LONGEST_LIST = 20_000_000
#: The command that writes the page of another command's folder again: it stays that command's, or
#: may be anyone's.
REPORT = "report"
#: Variable of the environment: the folder outside of which a command reads and writes nothing.
ONLY_BELOW = "IBRID_ONLY_BELOW"
#: Where the data that ship lie, which every command may read.
_SHIPPED = tuple(Path(__file__).resolve().parents[k] / "data" for k in (0, 1))
#: What follows the command in the list, of a file that the user named.
BY_NAME = ", by name"
#: The database of a run, and the beginning of names that belong to it.
DATABASE, ARCHIVE = "archive.sqlite", "archive."


@dataclass(frozen=True)
class Writer:
    """The command that writes.

    inputs : what the user calls a file that it reads -> where that lies. overwrite : whether it may
    replace files that it did not write, None for a command that has no such option; inputs and
    links are never replaced. named : outputs that the user calls by their own name. reads : folders
    from which it does; what is named may be one into which it writes. words : the command as the
    user wrote it. wrote : where it wrote what, by the SHA-256, since it began: an answer so far is
    its own also where no list can be. states : size and time of change of the inputs.
    """

    command: str
    inputs: Mapping[str, str | Path] = field(default_factory=dict)
    overwrite: bool | None = False
    named: frozenset[str] = frozenset()
    reads: tuple[Path, ...] = ()
    wrote: set[tuple[Path, str]] = field(default_factory=set)
    words: tuple[str, ...] = ()
    states: dict[Path, tuple[int, int] | None] = field(default_factory=dict)

    def note_states(self) -> None:
        """Note of the inputs, those that are new, how they are before they are read."""
        for path in map(Path, self.inputs.values()):
            self.states.setdefault(path.absolute(), _state(path))

    def changed(self, path: Path) -> bool:
        """Whether an input is another one than when it was read."""
        return self.states.get(path.absolute()) != _state(path)

    def is_free(self, path: Path) -> bool:
        """Whether the user named this very file, outside of all folders, where all but inputs is
        replaced.
        """
        written = map(Path, self.named)
        return (
            self.is_named(path)
            and not _is_of_a_run(path)
            and not _within(path, (*self.reads, *written))
        )

    def replaces(self, path: Path) -> bool:
        """Whether `overwrite` was said, and of a file that is no input."""
        is_input = self.is_named(path) and (_is_of_a_run(path) or _within(path, self.reads))
        return bool(self.overwrite) and not is_input

    def signs(self, path: Path) -> str:
        """As what a file stands in the list: what was named once may be named again, and is no
        answer of the command's own.
        """
        return f"{self.command}{BY_NAME}" if self.is_named(path) else self.command

    def require_no_input(self, path: Path) -> None:
        """Raise IbridError for a file that is one of the inputs."""
        for name, taken in self.inputs.items():
            if same_file(path, taken):
                raise IbridError(
                    f"{path}: would overwrite {name}, the same file; choose another place"
                )

    def is_named(self, path: Path) -> bool:
        """Whether the user named this very file."""
        return any(Path(one) == path for one in self.named)


@dataclass(frozen=True)
class Written:
    """A line of the list: the file's name, the SHA-256 of its content, and the command that wrote
    it.
    """

    file: str
    sha256: str
    by: str


#: How a list begins.
_FIRST = b'{"file": "'
#: Names that the system gives to files that the process has open, by their number or by these.
_OPEN_FILE = re.compile(
    r"/dev/(stdin|stdout|stderr)|(?:/dev/fd|/proc/(?:thread-)?self/fd)/([0-9]{1,9})"
)
_STREAMS = ("stdin", "stdout", "stderr")
_WRITER: ContextVar[Writer | None] = ContextVar("writer", default=None)


@contextmanager
def writing_as(
    command: str,
    inputs: Mapping[str, str | Path] | None = None,
    overwrite: bool | None = False,
    named: Iterable[str] = (),
    reads: Iterable[Path] = (),
    words: Iterable[str] = (),
) -> Iterator[None]:
    """Within, every file that `ibrid.writing` writes obeys the rule; within another command, the
    rule is that one's.
    """
    if _WRITER.get() is not None:
        yield
        return
    for path in (*(inputs or {}).values(), *reads):
        require_below(path)
    for path in named:
        require_below(path, written=True)
    writer = Writer(
        command, inputs or {}, overwrite, frozenset(named), tuple(reads), words=tuple(words)
    )
    writer.note_states()
    token = _WRITER.set(writer)
    try:
        yield
    finally:
        _WRITER.reset(token)


def also_reading(inputs: Mapping[str, str | Path]) -> None:
    """Add files that the command at work reads: they are inputs too, but for what it wrote itself.
    Raises IbridError where one is an output that is named.

    inputs : what the user calls a file -> where it lies.
    """
    if (writer := _WRITER.get()) is None:
        return
    written = {path for path, _ in writer.wrote}
    new = {
        name: place
        for name, place in inputs.items()
        if writer.inputs.get(name) != place and Path(place).absolute() not in written
    }
    if not new:
        return
    for path in new.values():
        require_below(path)
    extended = replace(writer, inputs={**writer.inputs, **new})
    extended.note_states()
    _WRITER.set(extended)
    for name in writer.named:
        replace(writer, inputs=new).require_no_input(Path(name))


def require_below(path: str | Path, *, written: bool = False) -> None:
    """Raise IbridError for a file outside of the folder that `ONLY_BELOW` names, also through a
    link; data that ship may be read.
    """
    if not (root := os.environ.get(ONLY_BELOW)):
        return
    place = Path(path).resolve()
    folders = (Path(root).resolve(), *(() if written else _SHIPPED))
    if not any(place.is_relative_to(one) for one in folders):
        raise IbridError(f"{path}: lies outside of {root}, to which this command is kept")


def command_at_work() -> tuple[tuple[str, ...], Mapping[str, str | Path]]:
    """The words of the command that is at work, and what it calls a file that it reads -> where
    that lies; nothing without one.
    """
    writer = _WRITER.get()
    return ((), {}) if writer is None else (writer.words, writer.inputs)


def changed_since_read(path: Path) -> bool:
    """Whether a file that the command at work reads was changed since it was announced."""
    writer = _WRITER.get()
    return writer is not None and writer.changed(path)


def announce(*paths: Path) -> None:
    """Say that files are read, or belong to what is read: `also_reading` by their own names."""
    also_reading({f"the input {path}": path for path in paths})


def require_own(path: Path) -> None:
    """Raise IbridError where the command that is at work may not write a file; nothing is asked
    where none is.
    """
    writer = _WRITER.get()
    if writer is None or (
        path.exists() and not path.is_file()
    ):  # a device or a pipe, which holds nothing
        return
    require_below(path, written=True)
    writer.require_no_input(path)
    if path.name == LIST or (
        path.name.startswith(ARCHIVE) and writer.is_named(path) and not writer.is_free(path)
    ):
        raise IbridError(
            f"{path}: is a name that ibrid keeps for itself there; choose another name"
        )
    if path.is_symlink() and open_number(path) is None:
        raise IbridError(
            f"{path}: must be a file of its own, found a link to {os.readlink(path)}, through "
            "which nothing is written; "
            "remove it or choose another place"
        )
    if writer.is_free(path):
        return
    if not path.exists() or writer.replaces(path) or path.stat().st_size == 0:
        return
    if (path.absolute(), _digest(path.read_bytes())) in writer.wrote:
        return
    if (strange := _why_not_own(path, writer.signs(path))) is not None:
        could = replace(writer, overwrite=writer.overwrite is not None).replaces(path)
        replacing = ", or replace it with --overwrite" if could else ""
        raise IbridError(
            f"{path}: {strange}; choose another place or move the file away{replacing}"
        )


def note_written(path: Path, content: bytes) -> None:
    """Put a file that is about to be written into the list of its folder; without a command, or
    where no list can be, nothing.
    """
    writer = _WRITER.get()
    if writer is None or writer.is_free(path):
        return
    writer.wrote.add((path.absolute(), _digest(content)))
    owner = _owner(path) if writer.command == REPORT else None
    _add(path.parent, [Written(path.name, _digest(content), owner or writer.signs(path))])


def remove_own(path: Path) -> None:
    """Take a file away by the same rule, if it is there."""
    require_own(path)
    path.unlink(missing_ok=True)


def adopt(folder: Path, names: Iterable[str]) -> None:
    """Take files for written by the command at work, in a folder of its own that an earlier version
    left without a list.
    """
    writer = _WRITER.get()
    if writer is None or (folder / LIST).exists():
        return
    files = [
        folder / name
        for name in names
        if (folder / name).is_file() and not (folder / name).is_symlink()
    ]
    _add(folder, [Written(file.name, _digest(file.read_bytes()), writer.command) for file in files])


def same_file(path: str | Path, other: str | Path) -> bool:
    """Whether two names are of one regular file, or of one place where none is yet."""
    try:
        if os.path.exists(path) and os.path.exists(other):
            return os.path.samefile(path, other) and os.path.isfile(path)
        return os.path.realpath(path) == os.path.realpath(other)
    except (OSError, ValueError):  # a name that no file can have: refused where it is opened
        return False


def open_number(path: Path) -> int | None:
    """The number of a file that the process has open, of a name such as /dev/stdout, which leads
    where the caller wants the output; None of any other name.
    """
    named = _OPEN_FILE.fullmatch(str(path.absolute()))
    if named is None:
        return None
    return _STREAMS.index(named[1]) if named[1] else int(named[2])


def _state(path: Path) -> tuple[int, int] | None:
    """Size and time of change of a file; None where there is none."""
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return status.st_size, status.st_mtime_ns


def _is_of_a_run(path: Path) -> bool:
    """Whether a file lies beside the database of a run."""
    return (path.parent / DATABASE).is_file()


def _within(path: Path, folders: Iterable[Path]) -> bool:
    return any(
        folder.is_dir() and path.resolve().is_relative_to(folder.resolve()) for folder in folders
    )


def _why_not_own(path: Path, signed: str) -> str | None:
    """Why a file is not one that a command wrote, which signs so, as the end of a sentence about
    it; None where it is.
    """
    lines = [line for line in _lines(path.parent) if line.file == path.name]
    content = _digest(path.read_bytes())
    writers = {line.by for line in lines if line.sha256 == content}
    command = signed.removesuffix(BY_NAME)
    page_again = command == REPORT and path.suffix == ".html"
    if signed in writers or (writers and page_again) or (REPORT in writers and signed == command):
        return None
    if writers:
        return (
            f"is an answer of ibrid {sorted(writers)[0].removesuffix(BY_NAME)}, which ibrid "
            f"{command} would replace"
        )
    if lines:
        return (
            f"was changed since ibrid {lines[-1].by.removesuffix(BY_NAME)} wrote it, and the "
            "change would be lost"
        )
    unlisted = (
        ""
        if (path.parent / LIST).exists()
        else f" (earlier versions left no list of their files, {LIST})"
    )
    return f"is there already, and ibrid {command} did not write it{unlisted}"


def _owner(path: Path) -> str | None:
    """The command that wrote a file last, None for a file of nobody's."""
    return next((line.by for line in reversed(_lines(path.parent)) if line.file == path.name), None)


def _lines(folder: Path) -> list[Written]:
    """The list of a folder; lines that are none of it are passed over."""
    file = folder / LIST
    written: list[Written] = []
    with suppress(OSError):
        if not file.is_file() or file.is_symlink() or file.stat().st_size > LONGEST_LIST:
            return []
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            with suppress(ValueError, TypeError, RecursionError):
                entry = Written(**json.loads(line))
                if all(isinstance(word, str) for word in vars(entry).values()):
                    written.append(entry)
    return written


def _add(folder: Path, lines: Iterable[Written]) -> None:
    """Add lines to the list of a folder, where that is a list and no other name of a file: to
    anything else nothing.
    """
    known = _lines(folder)
    text = "".join(f"{json.dumps(vars(line))}\n" for line in lines if line not in known)
    file = folder / LIST
    if not text or (file.exists() and not file.is_file()):  # a pipe would wait for a reader
        return
    with suppress(OSError):  # an answer without a line is worth more than none
        flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
        with os.fdopen(os.open(file, flags, 0o666), "r+b") as stream:
            begun = stream.read(len(_FIRST))
            if not _FIRST.startswith(begun) or os.fstat(stream.fileno()).st_nlink > 1:
                return
            if begun:
                stream.seek(-1, os.SEEK_END)
                text = (
                    text if stream.read() == b"\n" else f"\n{text}"
                )  # a disk was full in the middle of a line
            stream.write(text.encode())


def _digest(content: bytes) -> str:
    return sha256(content).hexdigest()
