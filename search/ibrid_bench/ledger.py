"""The results of a benchmark, one JSON object a line: what is there is not measured again."""

import json
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError

NAME = "results.jsonl"


class Ledger:
    """Rows by their `key`, kept in FOLDER/results.jsonl; a row is on the disk when `add` returns.

    The last line of a run that was killed may be torn: it is dropped. Raises IbridError when the
    folder cannot be written, or a line that is not the last is no row.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        self.rows: dict[str, Mapping[str, Any]] = {}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            text = self.path.read_text(encoding="utf-8") if self.path.exists() else ""
            whole = text[: text.rfind("\n") + 1]
            if whole != text:
                os.truncate(self.path, len(whole.encode()))
        except (OSError, UnicodeDecodeError) as error:
            raise IbridError(
                f"{self.path}: must be a file that can be read and written ({error}); try another "
                "--out"
            ) from None
        for number, line in enumerate(whole.splitlines(), 1):
            row = self._row(line, number)
            self.rows[row["key"]] = row

    def add(self, row: Mapping[str, Any]) -> None:
        """Append a row; IbridError when the disk does not take it."""
        try:
            with self.path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(dict(row), allow_nan=False) + "\n")
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise IbridError(
                f"{self.path}: cannot be written ({error.strerror}); make room and run again"
            ) from None
        self.rows[row["key"]] = row

    def _row(self, line: str, number: int) -> Mapping[str, Any]:
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            row = None
        if not isinstance(row, dict) or not isinstance(row.get("key"), str):
            raise IbridError(
                f"{self.path}, line {number}: is no result of this benchmark; delete it or try "
                "another --out"
            )
        return row


def resumable(name: str, out: Path, work: Callable[[], int]) -> int:
    """The exit status of `work`; 2 with one sentence for a wrong input, 1 for Ctrl-C, with how to
    go on from `out`.
    """
    try:
        return work()
    except IbridError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"\nstopped; the same command with --out {out} goes on from here", file=sys.stderr)
        return 1
