"""The store: every step of a run with its record in `archive.sqlite`; a killed process loses
nothing.
"""

import dataclasses
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Self, get_type_hints

from ibrid.errors import IbridError
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.foreign_data import json_in
from ibrid.modules.kind import ModuleKind
from ibrid.writing import PlainData
from ibrid_search.run.database import Database
from ibrid_search.step import Status, Step

#: Steps read at a time: a long run with long answers must fit in memory, and a reader must not hold
#: up the writer.
_PAGE = 500
#: A step that was lost and evaluated again keeps count of all attempts.
_EVALUATED = """
    INSERT INTO evaluations VALUES (?, ?, ?)
    ON CONFLICT (number) DO UPDATE SET attempts = attempts + excluded.attempts, record = excluded.record"""
_REOPENED = """
    UPDATE steps SET status = ?, reason = '', seconds = 0.0
    WHERE number = ? AND status IN ('lost', 'unfinished', 'timeout')"""
#: Made with the first call of a tool.
#: Bytes of a record's JSON at most; the largest that ibrid writes have a hundredth of that.
LONGEST_RECORD = 200_000_000
_CALLS = """CREATE TABLE IF NOT EXISTS calls (number INTEGER PRIMARY KEY, after INTEGER NOT NULL, tool TEXT NOT NULL,
    arguments TEXT NOT NULL, answer TEXT NOT NULL)"""
_CALLED = (
    "INSERT INTO calls (after, tool, arguments, answer) VALUES ((SELECT COALESCE(MAX(number), -1) "
    "FROM steps), ?, ?, ?)"
)


@dataclasses.dataclass(frozen=True)
class NotedCall:
    """A call of a tool. `after` : number of the last step when it was answered, -1 before any."""

    after: int
    tool: str
    arguments: Any
    answer: Mapping[str, Any]


class Store(AbstractContextManager["Store"]):
    """Steps, records (compressed JSON, a third of the size) and texts that stay, in SQLite with a
    write-ahead log.

    What a method has written when it returns survives the death of the process, SIGKILL included.
    synchronous=NORMAL: after a power failure the last moments may be missing, which a resumed run
    does again, but the file is whole. One process writes, any number read meanwhile; one thread
    uses a store. The folder must be on a disk of this machine. Every method raises IbridError, one
    sentence, when the disk is full, the file damaged or the store closed.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self.path = database.path

    @classmethod
    def create(cls, path: str | Path, meta: Mapping[str, str]) -> Self:
        """A new store, open for writing. An empty file, which a run that was killed as it began
        leaves, is taken over.

        Raises IbridError when there is a store already, another run is making one, or the place
        cannot be written.
        """
        tables = [(one, ()) for one in SCHEMA]
        texts = [(SET_META, (cell(key), cell(value))) for key, value in meta.items()]
        return cls(Database.create(Path(path), VERSION, tables + texts))

    @classmethod
    def open(cls, path: str | Path, read_only: bool = False) -> Self:
        """The store of an earlier run to go on with, or to read, also while another process writes
        it.

        Raises IbridError when it is missing, no archive, of another version, damaged, or written by
        another live run.
        """
        return cls(Database.open(Path(path), VERSION, read_only=read_only))

    @property
    def meta(self) -> dict[str, str]:
        """The texts that stay: data, start program, settings and the like."""
        texts = dict(self._database.rows("SELECT key, value FROM meta"))
        if not all(isinstance(text, str) for pair in texts.items() for text in pair):
            raise IbridError(
                f"{self.path}: what is told of the run is damaged; restore a copy, or start a new "
                "run"
            )
        return texts

    def set_meta(self, key: str, value: str) -> None:
        """Write one of the texts, replacing the one there was."""
        self._database.run(SET_META, cell(key), cell(value))

    def propose(self, step: Step) -> None:
        """Write a step, pending or refused; IbridError when its number is taken."""
        row = row_of(step)
        with self._database.transaction():
            if self._database.rows("SELECT 1 FROM steps WHERE number = ?", step.number):
                raise IbridError(
                    f"{self.path}: there is a step {step.number} already; a step is written once"
                )
            self._database.run(
                f"INSERT INTO steps ({COLUMNS}) VALUES ({', '.join('?' * len(FIELDS))})", *row
            )

    def conclude(
        self,
        number: int,
        *,
        status: Status,
        reason: str = "",
        record: Record | Mapping[str, Any] | None = None,
        attempts: int = 1,
        **numbers: Any,
    ) -> None:
        """Write how a pending step ended, with its record or the JSON of it; IbridError when it is
        not pending.

        `numbers` : fields of the step in the place of what the record says, such as `seconds`.
        `attempts` : how often it was evaluated.
        """
        plain = record.to_json() if isinstance(record, Record) else record
        packed = None if plain is None else zlib.compress(json_text(plain).encode(), 3)
        known = {name: value for name, value in numbers.items() if value is not None}
        spent = (
            {"seconds": record.seconds} if isinstance(record, Record) else {}
        )  # which its JSON does not tell
        ended = {"status": status, "reason": reason, **numbers_of(plain), **spent, **known}
        columns = ", ".join(f'"{name}" = ?' for name in ended)
        with self._database.transaction():
            if (found := self.step(number).status) is not Status.PENDING:
                raise IbridError(
                    f"{self.path}: step {number} must be pending to be concluded, it is {found}"
                )
            self._database.run(
                f"UPDATE steps SET {columns} WHERE number = ?", *map(cell, ended.values()), number
            )
            self._database.run(_EVALUATED, number, attempts, packed)

    def reopen(self, number: int) -> None:
        """Let a lost or unfinished step wait for its evaluation again; IbridError when it is
        neither.
        """
        if not self._database.run(_REOPENED, Status.PENDING, number):
            found = self.step(number).status
            raise IbridError(
                f"{self.path}: step {number} must be lost or unfinished to be evaluated again, it "
                f"is {found}"
            )

    def steps(self, after: int = -1) -> Iterator[Step]:
        """Steps with a number above `after`, in order; those written meanwhile are met too."""
        while found := self._steps("WHERE number > ? ORDER BY number LIMIT ?", after, _PAGE):
            yield from found
            after = found[-1].number

    def step(self, number: int) -> Step:
        """One step; IbridError when there is none of this number."""
        steps = self._steps("WHERE number = ?", number)
        if not steps:
            last = self._database.rows("SELECT MAX(number) FROM steps")[0][0]
            known = "there is none at all" if last is None else f"the last is {last}"
            raise IbridError(f"{self.path}: there is no step {number}; {known}")
        return steps[0]

    def record(self, number: int, vocabulary: str | Sequence[ModuleKind] = "extended") -> Record:
        """The record of a step; IbridError when it has none or it is damaged."""
        query = "SELECT record FROM evaluations WHERE number = ? AND record IS NOT NULL"
        if not (rows := self._database.rows(query, number)):
            raise IbridError(
                f"{self.path}: step {number} has no record, it is {self.step(number).status}"
            )
        try:
            plain = json_in(_unpacked(rows[0][0]))
        except (zlib.error, TypeError, ValueError):
            raise IbridError(
                f"{self.path}: the record of step {number} is damaged; evaluate its program again"
            ) from None
        return Record.from_json(plain, vocabulary)

    def pending(self) -> tuple[Step, ...]:
        """Steps that wait for their evaluation, in order."""
        return self._steps("WHERE status = ? ORDER BY number", Status.PENDING)

    def retried(self) -> dict[int, int]:
        """Steps that were begun more than once, since a worker was lost, and how often."""
        attempts_of = dict(
            self._database.rows(
                "SELECT number, attempts FROM evaluations WHERE attempts > 1 ORDER BY number"
            )
        )
        if not all(isinstance(attempts, int) for attempts in attempts_of.values()):
            raise IbridError(
                f"{self.path}: a count of attempts is damaged; restore a copy, or start a new run"
            )
        return attempts_of

    def note_call(self, tool: str, arguments: Any, answer: Mapping[str, Any]) -> None:
        """Write a call of a tool and what it was answered, after the last step that there is."""
        with self._database.transaction():
            self._database.run(_CALLS)
            self._database.run(
                _CALLED, *map(cell, (tool, json_text(arguments), json_text(dict(answer))))
            )

    def calls(self) -> tuple[NotedCall, ...]:
        """Calls of tools in their order; none in a run without any."""
        if not self._database.rows("SELECT 1 FROM sqlite_master WHERE name = 'calls'"):
            return ()
        rows = self._database.rows(
            "SELECT after, tool, arguments, answer FROM calls ORDER BY number"
        )
        try:
            return tuple(
                NotedCall(after, tool, json_in(given), json_in(got))
                for after, tool, given, got in rows
            )
        except (TypeError, ValueError):
            raise IbridError(
                f"{self.path}: a call is damaged; restore a copy, or start a new run"
            ) from None

    def close(self) -> None:
        """End; the right to write is free again. Twice is once."""
        self._database.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _steps(self, where: str, *values: Any) -> tuple[Step, ...]:
        rows = self._database.rows(f"SELECT {COLUMNS} FROM steps {where}", *values)
        try:
            return tuple(map(step_of, rows))
        except (TypeError, ValueError, RecursionError) as error:
            raise IbridError(
                f"{self.path}: a step is damaged ({error}); restore a copy, or start a new run"
            ) from None


#: Of `SCHEMA`; raise it when a table or the fields of `Step` change.
VERSION = 1
FIELDS = tuple(one.name for one in dataclasses.fields(Step))
#: The columns of a step, quoted for SQL.
COLUMNS = ", ".join(f'"{name}"' for name in FIELDS)
_DECLARED = COLUMNS.replace('"number"', '"number" INTEGER PRIMARY KEY')
SCHEMA = (
    f"CREATE TABLE steps ({_DECLARED})",
    "CREATE INDEX steps_by_status ON steps (status)",
    "CREATE TABLE evaluations (number INTEGER PRIMARY KEY, attempts INTEGER NOT NULL, record BLOB)",
    "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL)",
)
#: What the fields of a step are; a whole number is a number too.
_TYPES = {
    name: Mapping
    if name == "usage"
    else hint | int
    if hint == float | None or hint is float
    else hint
    for name, hint in get_type_hints(Step).items()
}
SET_META = "INSERT OR REPLACE INTO meta VALUES (?, ?)"


def cell(value: Any) -> Any:
    """What SQLite stores of a value.

    Half a surrogate pair, which a server may send, becomes a question mark.
    """
    if isinstance(value, str):
        return str(value).encode("utf-8", "replace").decode("utf-8")
    if isinstance(value, Mapping):
        return json_text(dict(value))
    return value.item() if hasattr(value, "item") else value


def json_text(value: Any) -> str:
    """JSON of plain data without spaces; IbridError for anything that has none, such as a NaN."""
    try:
        return json.dumps(value, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise IbridError(
            f"what goes into the store must be plain JSON data, found otherwise ({error})"
        ) from None


def _unpacked(content: bytes) -> bytes:
    """What was packed; ValueError for what becomes longer than any record."""
    unpacking = zlib.decompressobj()
    text = unpacking.decompress(content, LONGEST_RECORD)
    if unpacking.unconsumed_tail:
        raise ValueError("too long")
    return text


def row_of(step: Step) -> list[Any]:
    """The cells of a step in the order of `COLUMNS`."""
    return [cell(getattr(step, name)) for name in FIELDS]


def step_of(row: tuple[Any, ...]) -> Step:
    """The step of a row; ValueError or TypeError when the row was not written here."""
    fields = dict(zip(FIELDS, row, strict=True))
    fields["status"] = Status(fields["status"])
    fields["usage"] = json_in(fields["usage"])
    fields["stable"] = None if fields["stable"] is None else bool(fields["stable"])
    for name, value in fields.items():
        if not isinstance(value, _TYPES[name]):
            raise TypeError(f"{name} must not be {value!r:.40}")
    return Step(**fields)


def numbers_of(record: Mapping[str, Any] | None) -> PlainData:
    """What a step repeats of the fields of its record; stable only when it is at every operating
    point.
    """
    if record is None:
        return {}
    seconds = {"seconds": record.get("seconds", 0.0)}
    if record.get("outcome") != Outcome.OK:
        return seconds
    stable = record.get("stable", {})
    return seconds | {
        "nrmse": record.get("nrmse"),
        "reward": record.get("reward"),
        "stable": all(stable.values()) if stable else None,
        "order": record.get("order"),
        "free": record.get("free_parameters"),
    }
