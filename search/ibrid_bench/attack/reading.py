"""Everything that reads a record or a run of others, as its user would; what ended in anything but
an answer or a sentence.
"""

import contextlib
import io
import json
import random
import shutil
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ibrid_bench.attack.damage import damaged_json, damaged_run, damaged_table

from ibrid import cli
from ibrid.errors import IbridError
from ibrid.evaluation.record import read_record
from ibrid.report.texts.text import format_record

_OP, _FREQUENCIES = "p=1,q=0.3", "5:5000:6"
#: Commands on a record, from the quickest on; OUT stands for a file to write.
_COMMANDS = (
    ("predict", "RECORD", "--op", _OP, "--freq", _FREQUENCIES, "--out", "OUT.csv"),
    ("predict", "RECORD", "--op", "p=0.5,q=0", "--freq", _FREQUENCIES, "--out", "OUT.csv"),
    *(
        ("export", "RECORD", "--op", _OP, "--format", name, "--out", "OUT.x")
        for name in ("control-json", "mat", "npz", "modelica", "c", "csv", "touchstone")
    ),
    ("stability", "RECORD", "--scr", "2:5:2", "--report", "OUT.s.html"),
    ("report", "RECORD", "--out", "OUT.html"),
)


def records_tried(
    records: Sequence[Any], folder: Path, number: int, seed: int, commands: int = 4
) -> Iterator[str]:
    """Damage a record `number` times, read it by a few of the commands each time; yields what was
    unforeseen.
    """
    rng = random.Random(seed)
    path = folder / "record.json"
    for index in range(number):
        content, told = damaged_json(rng.choice(list(records)), rng)
        path.write_bytes(content)
        drawn = rng.sample(_COMMANDS, commands)
        for wrong in (_in_python(path), *(_commanded(words, path, folder) for words in drawn)):
            if wrong:
                yield f"record {index} ({told}): {wrong}"


def runs_tried(
    run: Path, data: str, folder: Path, number: int, seed: int, options: Sequence[str] = ()
) -> Iterator[str]:
    """Damage a copy of a run `number` times, write its page and go on with it; yields what was
    unforeseen.
    """
    rng = random.Random(seed)
    for index in range(number):
        damaged = folder / "run"
        shutil.rmtree(damaged, ignore_errors=True)
        shutil.copytree(run, damaged)
        told = damaged_run(damaged, rng)
        words = rng.choice(
            (
                ("report", "RECORD", "--out", "OUT.html"),
                ("search", data, "--out", "RECORD", "--resume", *options),
            )
        )
        if wrong := _commanded(words, damaged, folder):
            yield f"run {index} ({told}): {wrong}"


def events_tried(events: Path, folder: Path, number: int, seed: int) -> Iterator[str]:
    """Damage a file of records `number` times, look at it or play it back; yields what was
    unforeseen.
    """
    rng, whole = random.Random(seed), events.read_text(encoding="utf-8")
    path = folder / "damaged.csv"
    for index in range(number):
        path.write_bytes(damaged_table(whole, rng))
        words = rng.choice(
            (("inspect", "RECORD"), ("playback", "gfl", "RECORD", "--out", "OUT.playback"))
        )
        if wrong := _commanded(words, path, folder):
            yield f"events {index}: {wrong}"


def _in_python(path: Path) -> str:
    """A record as a notebook shows it and as the terminal does."""
    try:
        record = read_record(path)
    except IbridError as error:
        return _sentence(str(error))
    except Exception as error:
        return _place("reading it", error)
    for name, show in (
        ("the notebook", record._repr_html_),
        ("the terminal", lambda: format_record(record)),
    ):
        try:
            show()
        except Exception as error:  # also an IbridError: what was read can be shown
            return _place(name, error)
    return ""


def _commanded(words: Sequence[str], record: Path, folder: Path) -> str:
    """What was unforeseen in one command; "" for an answer, and for one sentence with exit status
    2.
    """
    known = {"RECORD": str(record)}
    arguments = [known.get(word, word.replace("OUT.", f"{folder / 'out'}.", 1)) for word in words]
    told = io.StringIO()
    try:
        with contextlib.redirect_stderr(told), contextlib.redirect_stdout(io.StringIO()):
            status = cli.main(arguments)
    except BaseException as error:
        return _place(f"ibrid {words[0]}", error)
    if status == cli.WRONG_INPUT:
        return _sentence(told.getvalue())
    return (
        ""
        if status == 0
        else f"ibrid {' '.join(words)} ends with {status}: {told.getvalue().strip()[-300:]}"
    )


def _sentence(text: str) -> str:
    """ "" for one sentence; a search may have shown its progress before."""
    told = [
        line for line in text.splitlines() if line.strip() and " evaluations, step " not in line
    ]
    return "" if len(told) == 1 and len(told[0]) < 2000 else f"not one sentence: {text[:300]!r}"


def _place(where: str, error: BaseException) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return (
        f"{where}: {type(error).__name__}: {str(error)[:150]} ({Path(last.filename).name} line "
        f"{last.lineno})"
    )


def plain(record: Any) -> Any:
    """The JSON of a record, as others would read it."""
    return json.loads(json.dumps(record.to_json(), allow_nan=False))
