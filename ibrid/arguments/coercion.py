"""From what a user has at hand to the values that public functions take: names of what ships,
paths, tables and responses of other packages.

`ibrid.border` asks `as_any_of` where an argument is of another kind than a function takes; the
command line reads its words here, too.
"""

import os
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from math import isfinite
from pathlib import Path
from typing import Any

from ibrid.arguments.places import exists, is_name, is_program_text, is_record, require_file
from ibrid.border import takes_kinds
from ibrid.errors import IbridError, ProgramError, SweepError
from ibrid.evaluation.record import Record, read_record
from ibrid.foreign_data import json_in, text_in
from ibrid.measurement.formats.bundle import is_there
from ibrid.measurement.formats.frd import from_system
from ibrid.measurement.hardware import hardware_sweeps
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import is_events_file, read_events
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import shipped_names, textbook
from ibrid.structure.diagrams.program import read_program


@takes_kinds
def as_sweep(given: Any, **keys: Any) -> Sweep:
    """Make a sweep of a sweep file, the name of a shipped sweep, a DataFrame, a scikit-rf Network
    or a python-control response or model.

    keys : what `given` does not say about itself (p, q, s_base_va, ..), as of `read_sweep`.

    Raises SweepError that says what there is instead, or what must be said beside it.
    """
    if isinstance(given, Sweep):
        return given
    if isinstance(given, str | os.PathLike):
        return _read_sweep(os.fspath(given), keys)
    if _is_of_python_control(given):
        if not {"p", "q"} <= set(keys):
            raise SweepError(
                "a response of python-control must come with the steady state: "
                "ibrid.from_system(system, p=0.8, q=0.1)"
            )
        return from_system(given, **keys)
    return read_sweep(given, **keys)


@takes_kinds
def as_events(given: Any, **keys: Any) -> Events:
    """Make records in time of their file or of a DataFrame; keys as of `read_events`."""
    if isinstance(given, Events):
        return given
    if isinstance(given, str | os.PathLike):
        text = os.fspath(given)
        require_file(text, (), "records of events", SweepError)
        if is_record(text):
            raise SweepError(
                f"{text} is a record of a fit, not records of events; give their file there"
            )
    return read_events(given, **keys)


@takes_kinds
def as_diagram(given: Any) -> Diagram:
    """Make a diagram of a program file, the name of a shipped diagram, or a record.

    Raises ProgramError for program text, which `parse_program` reads, and for what is nowhere.
    """
    if isinstance(given, Diagram):
        return given
    if isinstance(given, Record):
        return given.diagram
    if not isinstance(given, str | os.PathLike):
        raise ProgramError(
            "a diagram must be a program file, the name of a shipped diagram or a record; found "
            f"{type(given).__name__}"
        )
    text = os.fspath(given)
    if is_program_text(text):
        raise ProgramError(
            "a text stands for a name or a path; read program text with ibrid.parse_program(TEXT)"
        )
    if is_record(text):
        return read_record(text).diagram
    if is_name(text, shipped_names()):
        return textbook(text)
    require_file(text, shipped_names(), "a program file or a textbook diagram", ProgramError)
    return read_program(text)


@takes_kinds
def as_record(given: Any) -> Record:
    """Make a record of its JSON file, or of a search's answer or a gap's repaired model."""
    if isinstance(given, Record):
        return given
    for part in ("best", "repaired"):
        if isinstance(record := getattr(given, part, None), Record):
            return record
    if not isinstance(given, str | os.PathLike):
        raise IbridError(
            "a record must be its file, or the answer of a search or a gap; found "
            f"{type(given).__name__}"
        )
    text = os.fspath(given)
    if is_name(text, shipped_names()):
        raise IbridError(
            f"{text} is a diagram, and a record of its fit is needed; make one with "
            f'ibrid.evaluate("{text}", sweep)'
        )
    require_file(text, (), "a record of a fit (JSON)", IbridError)
    return read_record(text)


@takes_kinds
def load(path: str | os.PathLike) -> Sweep | Events | Record | Diagram | Mapping[str, Any]:
    """Read what was saved: a sweep, records of events, the record of a fit, or a program; of a
    folder of a search or a gap the record of its answer; of another answer its JSON, plain data.

    A name of a shipped diagram or sweep does as well. Raises IbridError for anything else.
    """
    text = os.fspath(path)
    if exists(text) and Path(text).is_dir():
        for name in _RECORDS:
            if (Path(text) / name).is_file():
                return as_record(Path(text) / name)
        if not is_name(text, (*shipped_names(), *known_sweeps())):
            raise IbridError(
                f"{text} must be a file or a folder with {' or '.join(_RECORDS)}; found neither in "
                "it, name a file of it"
            )
    if (answer := _answer_in(text)) is not None:
        return answer
    if is_record(text):
        return as_record(text)
    if is_name(text, shipped_names()):
        return as_diagram(text)
    if Path(text).suffix.lower() == ".py":
        return as_diagram(text)
    if holds_events(text):
        return as_events(text)
    return as_sweep(text)


def _answer_in(text: str) -> Mapping[str, Any] | None:
    """What `save` wrote of an answer that is neither data nor a model; None of anything else."""
    if not exists(text) or Path(text).suffix.lower() != ".json":
        return None
    with suppress(OSError, ValueError):
        content = json_in(text_in(Path(text)))
        schema = str(content.get("schema", "")) if isinstance(content, dict) else ""
        if schema.startswith("ibrid.") and not schema.startswith(_READ_OTHERWISE):
            if not _is_finite(content):
                raise IbridError(
                    f"{text}: must hold finite numbers; found one that is none or beyond every "
                    "float, write the answer again"
                )
            return content
    return None


def _is_finite(content: Any) -> bool:
    """Whether all numbers in plain data are, however deep it is."""
    left = [content]
    while left:
        one = left.pop()
        if isinstance(one, float) and not isfinite(one):
            return False
        left += one.values() if isinstance(one, dict) else one if isinstance(one, list) else ()
    return True


#: Schemas of records and of models, which are read as such.
_READ_OTHERWISE = ("ibrid.record/", "ibrid.state-space/")
#: The record of the answer in the folder of a search, and of a gap.
_RECORDS = ("best.json", "model.json")
#: Classes of arguments -> how something else is made one, the first that suits.
_MAKERS: Mapping[str, Callable[..., Any]] = {
    "Record": as_record,
    "Diagram": as_diagram,
    "Events": as_events,
    "Sweep": as_sweep,
}
#: What they are made of beside names and paths.
_TABLES = ("Events", "Sweep")


def as_any_of(given: Any, names: Collection[str], said: Mapping[str, Any]) -> Any:
    """What stands for a value of one of these classes as such a value; None where nothing does.

    said : what a sweep or records do not say about themselves.

    Raises IbridError where it is meant as one and cannot be read.
    """
    if isinstance(given, str | os.PathLike):
        return _MAKERS[_meant(os.fspath(given), names)](given, **said)
    if "Record" in names or "Diagram" in names:
        is_answer = any(
            isinstance(getattr(given, part, None), Record) for part in ("best", "repaired")
        )
        if is_answer and "Record" in names:
            return as_record(given)
        if isinstance(given, Record) and "Diagram" in names:
            return given.diagram
        return None
    if _is_of_python_control(given) or hasattr(given, "z0"):
        return as_sweep(given, **said) if "Sweep" in names else None
    if not hasattr(given, "columns") and not hasattr(given, "to_dataframe"):
        return None
    columns = {str(name) for name in getattr(given, "columns", ())}
    timed = "Events" in names and ("Sweep" not in names or {"record", "t"} <= columns)
    if timed:
        return as_events(given, **said)
    return as_sweep(given, **said) if "Sweep" in names else None


def _meant(text: str, names: Collection[str]) -> str:
    """Which of the classes a name or a path means."""
    if "Record" in names and ("Diagram" not in names or is_record(text)):
        return "Record"
    if "Diagram" in names:
        return "Diagram"
    if "Events" in names and ("Sweep" not in names or holds_events(text)):
        return "Events"
    return "Sweep"


def _read_sweep(text: str, keys: Mapping[str, Any]) -> Sweep:
    file = sweep_file(text)
    if file is None:
        require_file(text, known_sweeps(), "a sweep file or a shipped sweep", SweepError)
    if holds_events(text):
        raise SweepError(
            f"{text} holds records of events, and a sweep is needed; read them with "
            "ibrid.read_events, fit them with ibrid.evaluate_events"
        )
    return read_sweep(Path(text) if file is None else Path(file), **keys)


def _is_of_python_control(given: Any) -> bool:
    """Whether it is a response or a model of python-control, which is not imported to find out."""
    return any(one.__module__.partition(".")[0] == "control" for one in type(given).__mro__)


def holds_events(text: str) -> bool:
    """Whether there is a file of records in time at that place, and no sweep."""
    return is_there(Path(text)) and not Path(text).is_dir() and is_events_file(Path(text))


def sweep_file(text: str) -> str | Path | None:
    """Where the sweep of that name or path lies; None when there is none."""
    known = known_sweeps()
    return text if exists(text) and not is_name(text, known) else known.get(text)


def known_sweeps() -> Mapping[str, Path]:
    """Name -> file of the sweeps that ship, measured and computed ones."""
    return {**hardware_sweeps(), **benchmarks()}
