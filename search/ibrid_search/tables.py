"""The tables of the store, and a step as a row and back; nothing in a row is lost or rounded."""

import dataclasses
import json
from collections.abc import Mapping
from typing import Any, get_type_hints

from ibrid.errors import IbridError
from ibrid.evaluation.outcome import Outcome
from ibrid_search.step import Status, Step

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
    name: Mapping if name == "usage" else hint | int if hint == float | None or hint is float else hint
    for name, hint in get_type_hints(Step).items()
}
SET_META = "INSERT OR REPLACE INTO meta VALUES (?, ?)"


def cell(value: Any) -> Any:
    """What SQLite stores of a value. Half a surrogate pair, which a server may send, becomes a question mark."""
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
        raise IbridError(f"what goes into the store must be plain JSON data, found otherwise ({error})") from None


def row_of(step: Step) -> list[Any]:
    """The cells of a step in the order of `COLUMNS`."""
    return [cell(getattr(step, name)) for name in FIELDS]


def step_of(row: tuple[Any, ...]) -> Step:
    """The step of a row; ValueError or TypeError when the row was not written here."""
    found = dict(zip(FIELDS, row, strict=True))
    found["status"] = Status(found["status"])
    found["usage"] = json.loads(found["usage"])
    found["stable"] = None if found["stable"] is None else bool(found["stable"])
    for name, value in found.items():
        if not isinstance(value, _TYPES[name]):
            raise TypeError(f"{name} must not be {value!r:.40}")
    return Step(**found)


def numbers_of(record: Mapping[str, Any] | None) -> dict[str, Any]:
    """What a step repeats of the JSON of its record; stable only when it is at every operating point."""
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
