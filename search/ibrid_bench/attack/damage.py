"""Damaged records and archives: a value replaced, lost, moved, renamed or scaled; bytes of the text
or of the file changed.
"""

import copy
import json
import random
import sqlite3
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

#: What stands where something else should; NaN and infinities are what Python's JSON writes of
#: them.
STRANGE: tuple[Any, ...] = (
    None,
    "",
    "x",
    "\ud800",
    "\x00",
    "é" * 300,
    "a\nb",
    "<script>",
    "p=1,q=0.3",
    -1,
    0,
    1,
    2.5,
    1e300,
    -1e300,
    1e-300,
    10**18,
    10**400,
    float("nan"),
    float("inf"),
    True,
    False,
    [],
    [[]],
    [None],
    [1, 2],
    [1, 2, 3],
    {},
    {"": None},
    {"a": 1},
)
_CELLS: tuple[Any, ...] = (
    None,
    "",
    "x",
    -1,
    0,
    7,
    10**18,
    1e300,
    b"\x00\xff",
    "{}",
    "[1]",
    '{"a": 1}',
    "ok",
    "pending",
    "lost",
    "\x00",
)
_NAMES = ("", "x", "\ud800", "p=9,q=9", "plant.L_F", "é" * 100)
_FACTORS = (-1, 0, 1e3, 1e-3, 1e30, 1e-30)
#: Part of the changes that keep the type, so that they get past what checks types.
_SAME_TYPE = 0.7


def damaged(data: Any, rng: random.Random) -> tuple[Any, str]:
    """A copy of plain data with one to three places changed, and what was done; all depths are as
    likely.
    """
    data, told = copy.deepcopy(data), []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        places = [path for path in _paths(data) if path]
        depth = rng.choice(sorted({len(path) for path in places}))
        path = rng.choice([one for one in places if len(one) == depth])
        change = rng.choice((_replaced, _replaced, _replaced, _lost, _moved, _renamed, _scaled))
        change(_at(data, path[:-1]), path[-1], data, rng)
        told.append(f"{change.__name__.strip('_')} {'/'.join(map(str, path))}")
    return data, "; ".join(told).encode(errors="replace").decode()


def damaged_bytes(content: bytes, rng: random.Random, alphabet: bytes = bytes(range(256))) -> bytes:
    """A copy with a few bytes changed, runs lost, or the end cut off."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 6)):
        place = rng.randrange(max(len(changed), 1))
        if rng.random() < 0.3:
            del changed[place : place + rng.randint(1, 50)]
        elif changed:
            changed[min(place, len(changed) - 1)] = rng.choice(alphabet)
    if rng.random() < 0.1:
        del changed[rng.randrange(max(len(changed), 1)) :]
    return bytes(changed)


#: Ways to change a column of numbers, from most legal to least.
_COLUMNS: tuple[Callable[[float], float | str], ...] = (
    lambda value: -value,
    lambda value: 1e3 * value,
    lambda value: value / 1e6,
    lambda value: 0.0,
    lambda value: 1.0,
    lambda value: 1e300,
    lambda value: round(value, 1),
    lambda value: value + 377.0,
    lambda value: "nan",
)


def damaged_table(text: str, rng: random.Random) -> bytes:
    """A CSV with header lines, changed so that most of it still reads: a column or a piece of one
    scaled, flat, moved or of another sign, rows lost, doubled or exchanged, header lines lost; or
    bytes of it changed.
    """
    if rng.random() < 0.2:
        return damaged_bytes(text.encode(), rng, b"0123456789.,-+eEnaif:#\n \xff")
    lines = text.splitlines()
    start = next(number for number, line in enumerate(lines) if not line.startswith("#")) + 1
    for _ in range(rng.choice((1, 1, 2))):
        first, last = sorted(
            (rng.randrange(start, len(lines)), rng.randrange(start, len(lines) + 1))
        )
        way = rng.choice(("column", "column", "column", "lost", "doubled", "exchanged", "header"))
        if way == "column":
            column, change = rng.randrange(1, 6), rng.choice(_COLUMNS)
            first, last = (start, len(lines)) if rng.random() < 0.5 else (first, last)
            for number in range(first, last):
                cells = lines[number].split(",")
                cells[column] = str(change(float(cells[column])))
                lines[number] = ",".join(cells)
        elif way == "lost":
            del lines[first : last - (last - first == len(lines) - start)]
        elif way == "doubled":
            lines[first:first] = lines[first:last]
        elif way == "exchanged":
            lines[first:last] = lines[first:last][::-1]
        else:
            del lines[rng.randrange(start - 1)]
            start -= 1
        if len(lines) <= start or start < 2:
            break
    return "\n".join(lines).encode()


def damaged_json(data: Any, rng: random.Random) -> tuple[bytes, str]:
    """The text of damaged data, or damaged text, and what was done."""
    if rng.random() < 0.15:
        return damaged_bytes(
            json.dumps(data, indent=1).encode(), rng, b'{}[]",:0-9eE\x00\xff '
        ), "its text"
    changed, told = damaged(data, rng)
    return json.dumps(changed).encode(), told


def _paths(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    inside = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, inner in inside:
        yield from _paths(inner, (*path, key))


def _at(data: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        data = data[key]
    return data


def _replaced(place: Any, key: Any, data: Any, rng: random.Random) -> None:
    alike = [one for one in STRANGE if _kind(one) is _kind(place[key])]
    place[key] = rng.choice(alike if alike and rng.random() < _SAME_TYPE else STRANGE)


def _lost(place: Any, key: Any, data: Any, rng: random.Random) -> None:
    del place[key]


def _moved(place: Any, key: Any, data: Any, rng: random.Random) -> None:
    place[key] = copy.deepcopy(_at(data, rng.choice(list(_paths(data)))))


def _renamed(place: Any, key: Any, data: Any, rng: random.Random) -> None:
    if isinstance(place, dict):
        place[rng.choice(_NAMES)] = place.pop(key)


def _scaled(place: Any, key: Any, data: Any, rng: random.Random) -> None:
    if _kind(place[key]) is float and abs(place[key]) < 1e200:
        place[key] *= rng.choice(_FACTORS)


def _kind(value: Any) -> type:
    return float if type(value) is int else type(value)


def damaged_run(folder: Path, rng: random.Random) -> str:
    """Damage one file of a run's folder, in place: a cell of the archive or its bytes, the options,
    or what was selected.
    """
    archive = folder / "archive.sqlite"
    way = rng.choice(("cell", "cell", "cell", "cell", "bytes", "run.toml", "selection.json"))
    if way == "cell":
        return _damaged_cell(archive, rng)
    path = archive if way == "bytes" else folder / way
    if path.suffix == ".json" and path.is_file():
        content, told = damaged_json(json.loads(path.read_text()), rng)
    else:
        content, told = (
            damaged_bytes(path.read_bytes() if path.is_file() else b"", rng),
            "its bytes",
        )
    path.write_bytes(content)
    return f"{path.name}: {told}"


def _damaged_cell(archive: Path, rng: random.Random) -> str:
    """Another value in one cell; what a record or a table of a cell holds is damaged inside."""
    with closing(sqlite3.connect(archive, isolation_level=None)) as base:
        table = rng.choice(("steps", "evaluations", "evaluations", "meta"))
        columns = [row[1] for row in base.execute(f"PRAGMA table_info({table})")]
        column = rng.choice(columns)
        cells = base.execute(f'SELECT rowid, "{column}" FROM {table}').fetchall()
        row, value = rng.choice(cells)
        if column == "record" and value is not None and rng.random() < 0.8:
            content, told = damaged_json(json.loads(zlib.decompress(value)), rng)
            changed: Any = zlib.compress(content)
        else:
            changed, told = rng.choice(_CELLS), "replaced"
            if isinstance(value, str) and value and rng.random() < 0.5:
                changed = damaged_bytes(value.encode(), rng).decode(errors="replace")
        with suppress(sqlite3.Error):  # a constraint of the table keeps its word
            base.execute(f'UPDATE {table} SET "{column}" = ? WHERE rowid = ?', (changed, row))
        base.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return f"{table}.{column} of row {row}: {told}"
