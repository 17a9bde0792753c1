"""An SQLite file with one writer and any number of readers; what can go wrong with it is one
sentence.
"""

import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any, Self

from ibrid.errors import IbridError
from ibrid.interrupts import heed_interrupt
from ibrid.writing import inside

#: Marks a file as the archive of a search ("ibrd"); PRAGMA application_id.
APPLICATION = 0x69627264
#: Seconds to wait for a reader or a backup that holds the file for a moment, and for one that asks
#: whether somebody writes.
PATIENCE, GLANCE = 10.0, 0.5
LOCK = ".lock"
#: Begins a journal, and ends one that names a file to be deleted with it.
_JOURNAL = bytes.fromhex("d9d505f920a163d7")
_REASONS = {
    sqlite3.SQLITE_FULL: "the disk is full; make room and resume the run, nothing recorded so far "
    "is lost",
    sqlite3.SQLITE_CORRUPT: "the file is damaged; restore a copy, or start a new run",
    sqlite3.SQLITE_NOTADB: "it is not a database, or its beginning is damaged; give the "
    "archive.sqlite of a run",
    sqlite3.SQLITE_BUSY: "another process holds it; wait for it to end, or stop it",
    sqlite3.SQLITE_READONLY: "it was opened for reading, or its folder is not writable; open it "
    "for writing",
    sqlite3.SQLITE_CANTOPEN: "it cannot be opened; see that its folder exists and is writable",
    sqlite3.SQLITE_IOERR: "the disk cannot be read or written; see that it works and has room",
}


class Database:
    """A file in WAL mode.

    What a method has written when it returns survives the death of the process.
    """

    def __init__(self, path: Path, mode: str) -> None:
        """Open in a mode of SQLite's URIs: ro, rw or rwc; the last two as the only writer."""
        self.path = path
        _require_own_files(path)
        with ExitStack() as opened:
            if mode != "ro":
                opened.enter_context(closing(_become_writer(path)))
            with _in_a_sentence(path):
                uri = f"{path.absolute().as_uri()}?mode={mode}"
                self._connection = sqlite3.connect(
                    uri, uri=True, isolation_level=None, timeout=PATIENCE
                )
                opened.enter_context(closing(self._connection))
                self._connection.execute("PRAGMA synchronous = NORMAL")
            self._opened = opened.pop_all()

    @classmethod
    def create(
        cls, path: Path, version: int, statements: Iterable[tuple[str, Sequence[Any]]]
    ) -> Self:
        """A new file after these statements, all or none; IbridError when one with tables is
        there.
        """
        if not path.parent.is_dir():
            raise IbridError(f"{path}: there is no folder {path.parent}; make it first")
        database = cls(path, "rwc")
        with database.closed_on_error():
            if database.rows("SELECT 1 FROM sqlite_master"):
                raise IbridError(
                    f"{path}: there is a run already; resume it, or choose another folder"
                )
            database.run("PRAGMA journal_mode = WAL")
            with database.transaction():
                for statement, values in statements:
                    database.run(statement, *values)
                database.run(f"PRAGMA application_id = {APPLICATION}")
                database.run(f"PRAGMA user_version = {version}")
        return database

    @classmethod
    def open(cls, path: Path, version: int, *, read_only: bool) -> Self:
        """A file that `create` made with the same version; one opened for writing is first searched
        for damage.
        """
        if not path.is_file():
            raise IbridError(
                f"{path}: there is no such archive; give the folder of a run, or start one"
            )
        database = cls(path, "ro" if read_only else "rw")
        with database.closed_on_error():
            database._require(version)
            if not read_only and (found := database.rows("PRAGMA quick_check(1)")[0][0]) != "ok":
                what = " ".join(found.split())
                raise IbridError(
                    f"{path}: the file is damaged ({what}); restore a copy, or start a new run"
                )
        return database

    def run(self, statement: str, *values: Any) -> int:
        """Carry out a statement; the number of rows that it changed."""
        with _in_a_sentence(self.path):
            return self._connection.execute(statement, values).rowcount

    def rows(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        """The rows that a query finds."""
        with _in_a_sentence(self.path):
            return self._connection.execute(query, values).fetchall()

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """All that the block writes, or nothing, also when it is interrupted."""
        heed_interrupt()
        self.run("BEGIN IMMEDIATE")
        try:
            yield
            self.run("COMMIT")
        except BaseException:
            if self._connection.in_transaction:  # a full disk may have rolled back already
                self.run("ROLLBACK")
            raise

    def close(self) -> None:
        """End; the right to write is free again. Twice is once."""
        with _in_a_sentence(self.path):
            self._opened.close()

    @contextmanager
    def closed_on_error(self) -> Iterator[None]:
        """Close when the block raises."""
        try:
            yield
        except BaseException:
            self.close()
            raise

    def _require(self, version: int) -> None:
        application, stored = (
            self.rows("PRAGMA application_id")[0][0],
            self.rows("PRAGMA user_version")[0][0],
        )
        if application != APPLICATION:
            empty = not self.rows("SELECT 1 FROM sqlite_master")
            what = (
                "it is empty, of a run that ended before it began"
                if empty
                else "it is a database of something else"
            )
            raise IbridError(f"{self.path}: {what}; start a new run in another folder")
        if stored != version:
            raise IbridError(
                f"{self.path}: the archive must have schema version {version}, found {stored}; "
                "read it with the version of ibrid that wrote it, or start a new run"
            )
        if self.rows("SELECT 1 FROM sqlite_master WHERE type NOT IN ('table', 'index')"):
            raise IbridError(
                f"{self.path}: the file is damaged (it has views or triggers); restore a copy, or "
                "start a new run"
            )


def _require_own_files(path: Path) -> None:
    """Raise IbridError where a file that SQLite opens with `path`, to read, write or delete it,
    leads elsewhere or is none of SQLite's.
    """
    for base in (path, path.with_suffix(LOCK)):
        for ending in ("", "-wal", "-shm", "-journal"):
            file = inside(base.parent, base.name + ending)
            if ending != "-journal" or not file.is_file():
                continue
            journal = file.read_bytes()
            if journal[:8] not in (b"", bytes(8), _JOURNAL):
                raise IbridError(
                    f"{file}: is no journal of a run, and would be deleted; move it away and try "
                    "again"
                )
            if journal.endswith(_JOURNAL):
                raise IbridError(
                    f"{file}: names a file elsewhere, which no journal of a run does; remove it "
                    "and try again"
                )


def _become_writer(path: Path) -> sqlite3.Connection:
    """Hold the only right to write `path` until the connection is closed or the process ends,
    however it ends.

    The right is a lock of the operating system on an empty file beside it, which stays. IbridError
    when it is taken.
    """
    lock = path.with_suffix(LOCK)
    with _in_a_sentence(lock):
        connection = sqlite3.connect(lock, isolation_level=None, timeout=GLANCE)
        try:
            connection.execute("BEGIN EXCLUSIVE")
        except sqlite3.Error as error:
            connection.close()
            if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
                raise IbridError(
                    f"{path}: another live run is writing it; wait for it to end, or stop it"
                ) from None
            raise
    return connection


def is_being_written(path: Path) -> bool:
    """Whether a live process holds the right to write `path`; it asks without taking it."""
    lock = inside(path.parent, path.with_suffix(LOCK).name)
    if not lock.is_file():
        return False
    address = f"{lock.absolute().as_uri()}?mode=ro"
    with _in_a_sentence(lock), closing(sqlite3.connect(address, uri=True, timeout=0.0)) as asking:
        try:
            asking.execute("SELECT 1 FROM sqlite_master")
        except sqlite3.Error as error:
            if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
                return True
            raise
    return False


@contextmanager
def _in_a_sentence(path: Path) -> Iterator[None]:
    """Turn what SQLite complains about into an IbridError that names the file and the next step."""
    try:
        yield
    except sqlite3.Error as error:
        otherwise = f"{str(error).rstrip('.')}; open it again, in the thread that uses it"
        no_text = str(error).startswith("Could not decode to UTF-8")
        code = sqlite3.SQLITE_CORRUPT if no_text else getattr(error, "sqlite_errorcode", 0) & 0xFF
        reason = _REASONS.get(code, otherwise)
        raise IbridError(f"{path}: {reason}") from error
