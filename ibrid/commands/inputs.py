"""From words on the command line to diagrams, sweeps and options; heavy imports wait until a
command needs them.
"""

from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ibrid.arguments.places import exists, require_file
from ibrid.errors import IbridError, SweepError
from ibrid.foreign_data import json_in
from ibrid.foreign_text import place_shown
from ibrid.own_files import also_reading
from ibrid.ranges import LONGEST_WHOLE, require_in_range, written_number, written_whole
from ibrid.streams import complain

if TYPE_CHECKING:
    from ibrid.analysis.grids.grid import MeasuredGrid, SeriesRL
    from ibrid.evaluation.record import Record
    from ibrid.fit.settings import FitSettings
    from ibrid.measurement.recordings.events import Events
    from ibrid.measurement.sweeps.sweep import Sweep
    from ibrid.modules.vocabulary import Vocabulary
    from ibrid.structure.diagrams.diagram import Diagram
    from ibrid.structure.network.outside import Outside

#: Endings of a file that is a program; anything else that exists holds data or a model.
PROGRAM_ENDINGS = (".py", ".txt")
#: Files of a COMTRADE record.
_COMTRADE = (".cfg", ".dat", ".hdr", ".inf")
Number = TypeVar("Number", int, float)


def program(text: str) -> "Diagram":
    """The diagram in a program file or of a record, else the textbook diagram of that name."""
    from ibrid.arguments.coercion import as_diagram

    return as_diagram(text)


def fit_settings_of(arguments: Namespace) -> "FitSettings":
    """The settings that `--effort` and `--restarts` ask for."""
    from ibrid.fit.settings import fit_settings

    settings = fit_settings(arguments.effort)
    if arguments.restarts is None:
        return settings
    return replace(settings, restarts=arguments.restarts)


def data(text: str) -> "Sweep":
    """The sweep in a file, else the shipped or hardware sweep of that name."""
    from ibrid.measurement.formats.model_poles import MODEL
    from ibrid.measurement.importing.importing import MIND

    file = sweep_file(text)
    if file is None:
        from ibrid.arguments.coercion import known_sweeps

        require_file(text, known_sweeps(), "a sweep file or a shipped sweep", SweepError)
    sweep = _sweep_at(text if file is None else file)
    for note in sweep.notes:
        if note.startswith((MODEL, MIND)):
            complain(f"{text}: {note}.")
    return sweep


def simulation(text: str, measured: "Sweep") -> "Sweep":
    """The sweep of a simulation; a state space is sampled where the other sweep was measured."""
    import numpy as np

    frequency = np.unique(np.concatenate([point.frequency for point in measured.points]))
    file = sweep_file(text)
    return _sweep_at(text if file is None else file, frequency)


def _sweep_at(file: str | Path, frequency: Any = None) -> "Sweep":
    """The sweep in a file; SweepError says where what it leaves out can be said."""
    from ibrid.measurement.importing.unsaid import UnsaidError
    from ibrid.measurement.read import read_sweep

    try:
        return read_sweep(file, frequency=frequency)
    except UnsaidError as reason:
        raise SweepError(
            f"{reason} These are options of ibrid import {file} --out sweep.csv, which "
            f"writes a sweep file; or lines of {file}.meta, such as unit: pu and p: 0.8"
        ) from None


def predicted(text: str, sweep: "Sweep", kinds: Sequence[str] = ()) -> "Sweep":
    """What the record in a file answers at the operating points and frequencies of a sweep."""
    from dataclasses import replace

    from ibrid.analysis.models.prediction import predict, predicted_sweep

    model = record(text, kinds)
    answers = [
        replace(predict(model, point.op, point.frequency), op=point.op) for point in sweep.points
    ]
    return predicted_sweep(model, answers)


def grid(text: str, f0_hz: float) -> "SeriesRL | MeasuredGrid":
    """The grid that `--grid` says: values when written so, else the impedance in a file."""
    from math import pi

    from ibrid.analysis.grids.grid import RL_FORM, measured_grid, series_rl

    if "=" in text and not exists(text):
        return series_rl(text, 2 * pi * f0_hz)
    if not exists(text):
        raise IbridError(f"--grid {text[:200]!r}: there is no such file; {RL_FORM}")
    return measured_grid(data(text), f0_hz)


def has_response(text: str) -> bool:
    """Whether a word names a sweep, a state space or a record, and no program."""
    if exists(text):
        return Path(text).suffix.lower() not in PROGRAM_ENDINGS
    from ibrid.arguments.coercion import known_sweeps
    from ibrid.structure.diagrams.library import shipped_names

    return text in known_sweeps() and text not in shipped_names()


def measured(text: str, *, robust: bool = False) -> "Sweep":
    """`data`, whose labels, units and rows are contradicted on the error stream where its numbers
    allow.

    robust : leave out the rows that all others contradict.
    """
    from ibrid.measurement.conventions.contradictions import check_conventions
    from ibrid.measurement.quality.plausibility import implausible_numbers
    from ibrid.measurement.quality.wrong_rows import contradicted_rows

    sweep = without_wrong_rows(data(text)) if robust else data(text)
    for sentence in (
        *contradicted_rows(sweep),
        *check_conventions(sweep).warnings,
        *implausible_numbers(sweep),
    ):
        complain(f"of the data: {sentence}")
    return sweep


def without_wrong_rows(sweep: "Sweep") -> "Sweep":
    """The sweep without the rows that all others contradict, which are named on the error
    stream.
    """
    from ibrid.measurement.quality import wrong_rows

    for point in sweep.points:
        if rows := wrong_rows.wrong_rows(point):
            complain(f"left out of {point.op.name}: {'; '.join(row.words for row in rows)}")
    return wrong_rows.without_wrong_rows(sweep)


def holds_events(text: str) -> bool:
    """Whether there is a file of records in time at that place, and no sweep."""
    from ibrid.arguments import coercion

    return coercion.holds_events(text)


#: Options that say what files of records do not.
OF_EVENTS = ("channels", "base", "begin", "end")


def said_of_events(arguments: Namespace) -> dict[str, Any]:
    """What the options of a command say of records, by the keys of `read_events`."""
    return {name: said for name in OF_EVENTS if (said := getattr(arguments, name)) is not None}


def events(text: str, said: Mapping[str, Any] | None = None) -> "Events":
    """The records in a file; what contradicts itself in them is said on the error stream.

    said : of `said_of_events`.
    """
    from ibrid.measurement.quality.event_contradictions import contradictions

    records = read_events_at(text, said or {})
    for sentence in contradictions(records):
        complain(f"of the events: {sentence}")
    return records


def read_events_at(text: str, said: Mapping[str, Any]) -> "Events":
    """The records in a file, nothing said of them; SweepError says where what it leaves out can be
    said.
    """
    from ibrid.arguments.coercion import as_events
    from ibrid.measurement.importing.unsaid import UnsaidError

    try:
        return as_events(text, **said)
    except UnsaidError as reason:
        raise SweepError(
            f"{reason} These are options of ibrid import {text} --out events.csv, which "
            f"writes an events file; or lines of {text}.meta, such as ratio: 1"
        ) from None


def require_no_events_options(arguments: Namespace) -> None:
    """IbridError for options of records where there are none."""
    if said_of_events(arguments):
        raise IbridError(
            "--channels and --base are of records of events, as --from and --to are, and none are "
            "given; leave them out"
        )


def measured_or_events(arguments: Namespace) -> "tuple[Sweep, Events | None] | tuple[None, Events]":
    """The sweep and the records that DATA and --events name; DATA may be either."""
    options = said_of_events(arguments)
    if not holds_events(arguments.data):
        if arguments.events is not None:
            return measured(arguments.data, robust=arguments.robust), events(
                arguments.events, options
            )
        require_no_events_options(arguments)
        return measured(arguments.data, robust=arguments.robust), None
    require_no_second_events(arguments)
    return None, events(arguments.data, options)


def require_no_second_events(arguments: Namespace) -> None:
    """IbridError for records as DATA and as `--events`."""
    if arguments.events is not None:
        raise IbridError(
            f"{arguments.data} holds records of events, as --events does; give a sweep as DATA or "
            "leave one out"
        )


def port(text: str | None, data: "Sweep | Events | None") -> "Outside":
    """The port in a file, on the base of the data; nothing without one."""
    from ibrid.structure.network.outside import NOTHING
    from ibrid.structure.network.port_file import read_port

    return NOTHING if text is None or data is None else read_port(text, data)


def require_no_plant(arguments: Namespace) -> None:
    """IbridError for `--port` where records of events are asked about."""
    if arguments.port is not None:
        raise IbridError(
            "--port gives a plant, which answers sweeps, not records of events; leave one of them "
            "out"
        )


def sweep_file(text: str) -> str | Path | None:
    """Where the sweep of `data` lies; None when there is none."""
    from ibrid.arguments import coercion

    return coercion.sweep_file(text)


def files_named(arguments: Sequence[tuple[str, Any]]) -> dict[str, str | Path]:
    """The files among the words of a command, by what the user calls them; of a COMTRADE record
    both of its files.

    arguments : what the user calls an argument, with its word or its words; two may be called
    alike.
    """
    files: dict[str, str | Path] = {}
    for called, given in arguments:
        words = [
            word
            for word in (given if isinstance(given, list) else [given])
            if isinstance(word, str)
        ]
        for word in words:
            name = called if len(words) == 1 and called not in files else f"{called} {word}"
            if called.startswith("DATA") and (shipped := sweep_file(word)) is not None:
                files[name] = shipped
            if exists(word) and Path(word).is_file():
                files[name] = word
                files |= {f"{beside.name} of {name}": beside for beside in _read_beside(Path(word))}
    return files


def folders_named(arguments: Sequence[tuple[str, Any]]) -> list[Path]:
    """The folders among the words of a command, such as a run's.

    arguments : as of `files_named`.
    """
    words = [
        word for _, given in arguments for word in (given if isinstance(given, list) else [given])
    ]
    return [
        Path(word)
        for word in words
        if isinstance(word, str) and exists(word) and Path(word).is_dir()
    ]


def _read_beside(path: Path) -> list[Path]:
    """What is read with a file: the lines in its .meta, and the other files of a COMTRADE
    record.
    """
    record = _record_beside(path)
    meta = [one.with_name(f"{one.name}.meta") for one in (path, *record)]
    return [*(one for one in meta if one.is_file()), *record]


def _record_beside(path: Path) -> list[Path]:
    """The other files of a COMTRADE record."""
    if path.suffix.lower() not in (".cfg", ".dat"):
        return []
    return [
        one
        for one in path.parent.glob("*.*")
        if one.stem == path.stem and one.suffix.lower() in _COMTRADE
    ]


def vocabulary(text: str = "extended", files: Sequence[str] = ()) -> "str | Vocabulary":
    """The vocabulary of that name, the extended one with the kinds of plug-ins; and those in files
    of the user's own.
    """
    from ibrid.commands.own_kinds import with_own_kinds
    from ibrid.modules.vocabulary import choose_vocabulary
    from ibrid.plugins import extended_vocabulary

    known = extended_vocabulary(complain) if text == "extended" else text
    return with_own_kinds(choose_vocabulary(known), files) if files else known


def record(path: str | Path, files: Sequence[str] = ()) -> "Record":
    """The record in a file, whose program may have kinds of plug-ins and of the user's own files;
    its data are inputs too.
    """
    from ibrid.evaluation.record import read_record

    found = read_record(path, vocabulary(files=files))
    also_reading_data("the record's", found.settings)
    return found


def also_reading_data(whose: str, said: Mapping[str, Any]) -> None:
    """Add the files of data and events that a record or a run says it was made from to what the
    command reads.
    """
    also_reading(
        {
            f"{whose} {name}": place_shown(place)
            for name in ("data", "events")
            if isinstance(place := said.get(name), str)
        }
    )


def _number(
    text: str, kind: Callable[[str], Number], fits: Callable[[Number], bool], what: str
) -> Number:
    with suppress(ValueError):
        if fits(value := kind(text)):
            return value
    short = f" of at most {LONGEST_WHOLE} digits" if kind is written_whole else ""
    short = short if len(text) > LONGEST_WHOLE else ""
    raise ArgumentTypeError(f"must be {what}{short}, found {text!r:.60}")


def positive(text: str) -> float:
    """A positive finite number, for argparse."""
    return _number(text, written_number, lambda value: 0 < value < inf, "a positive number")


def count(text: str) -> int:
    """A whole number from 1 on, for argparse."""
    return _number(text, written_whole, lambda value: value >= 1, "a whole number, 1 or more")


def natural(text: str) -> int:
    """A whole number from 0 on, for argparse."""
    return _number(text, written_whole, lambda value: value >= 0, "a whole number, 0 or more")


def bus(text: str) -> int:
    """The number of a bus in a file of dynamic data, for argparse: PSS/E has six digits."""
    return _number(text, written_whole, lambda value: 1 <= value < 10**6, "a bus, 1 to 999999")


def tcp_port(text: str) -> int:
    """The number of a port, for argparse; 0 is any free one."""
    return _number(
        text, written_whole, lambda value: 0 <= value < 2**16, "the number of a port, 0 to 65535"
    )


def finite(text: str) -> float:
    """A finite number, for argparse."""
    return _number(text, written_number, isfinite, "a finite number")


def field(text: str) -> tuple[str, Any]:
    """A field of a request, for argparse; a value that is no JSON is text."""
    name, equals, value = text.partition("=")
    if not (equals and name.isidentifier()):
        raise ArgumentTypeError(f"must be NAME=JSON, such as top_p=0.9; found {text!r:.60}")
    try:
        return name, json_in(value)
    except ValueError:
        return name, value


def price(text: str) -> tuple[float, float]:
    """Prices of tokens in and out, for argparse."""
    try:
        price_in, price_out = map(written_number, text.split(","))
    except ValueError:
        price_in = price_out = -1.0
    if not (0 <= price_in < float("inf") and 0 <= price_out < float("inf")):
        raise ArgumentTypeError(
            f"must be two prices IN,OUT, not negative, such as 0.5,1.5; found {text!r:.60}"
        )
    return price_in, price_out


def overrides(settings: Iterable[str]) -> dict[str, float | str]:
    """name=value pairs; the value is a number where it reads as one."""
    values: dict[str, float | str] = {}
    for setting in settings:
        name, mark, value = (part.strip() for part in setting.partition("="))
        if not (name and mark and value):
            raise IbridError(
                f"--set is written name=value, for instance plant.L_F=0.1; found {setting!r}"
            )
        if name in values:
            raise IbridError(f"--set {name} is given twice; keep one")
        try:
            values[name] = number = written_number(value)
        except ValueError:
            values[name] = value
            continue
        require_in_range("value", number, f"--set {name}", IbridError)
    return values
