"""Where answers go: JSON to a file or, for "-", to the terminal; sentences about a wrong input to
the error stream.
"""

import shlex
from argparse import Namespace
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ibrid.errors import IbridError
from ibrid.own_files import same_file
from ibrid.writing import json_lines, require_place, write_whole

if TYPE_CHECKING:
    from ibrid.measurement.recordings.events import Events
    from ibrid.measurement.sweeps.sweep import Sweep
    from ibrid.plants.reference import ReferenceInverter

TERMINAL = "-"
#: Exit status of a command that a limit ended before it was finished; what was found is kept.
UNFINISHED = 3
#: The same of one that Ctrl-C ended.
INTERRUPTED = 130


def require_json_place(where: str | None) -> None:
    """Raise IbridError before any work when `--json OUT` cannot be written."""
    if where is not None and where != TERMINAL:
        require_place(where)


def require_distinct(outputs: Mapping[str, str | Path | None]) -> None:
    """Raise IbridError before any work when two outputs are one file.

    outputs : what the user calls it, such as "--json" -> path. None and the terminal pass.
    """
    written = {
        name: path
        for name, path in outputs.items()
        if path is not None and not (name == "--json" and path == TERMINAL)
    }
    for (other, taken), (name, path) in combinations(written.items(), 2):
        if same_file(path, taken):
            raise IbridError(
                f"{other} and {name} must be two files, found {path} for both; rename one"
            )


def give_json(content: Any, where: str | None) -> bool:
    """Write or print JSON as asked; True when it was printed, so that the table is left out."""
    if where is None:
        return False
    text = json_lines(content)
    if where == TERMINAL:
        print(text, end="")
        return True
    write_whole(where, text)
    return False


def say_sweep(sweep: "Sweep", out: str) -> None:
    """Say what a sweep file holds."""
    frequencies = len(sweep.points[0].frequency)
    print(f"{out}: {frequencies} frequencies at {'; '.join(sweep.names)}")


def give_events(events: "Events", out: str, *header: str) -> None:
    """Write records and say what the file holds; header : lines of it."""
    from ibrid.measurement.formats.event_csv import write_events
    from ibrid.measurement.sweeps.quantities import counted

    write_events(events, out, header=header)
    print(f"{out}: {counted(len(events.records), 'record')}: {'; '.join(events.names)}")


def made_of(plant: "ReferenceInverter", line: str) -> tuple[str, str, str]:
    """Lines of a file that a command line made of a reference inverter."""
    values = ", ".join(f"{name} = {value!r}" for name, value in plant.diagram_values.items())
    return f"made by: {line}", f"inverter: {plant.source}", f"true parameters: {values}"


def command_line(arguments: Namespace, *words: str, options: Sequence[str]) -> str:
    """The command line that makes the same numbers again; an option is there for each of its
    values.
    """
    line = ["ibrid", *words]
    for option in options:
        given = getattr(arguments, option)
        for value in given if isinstance(given, list) else [given]:
            if value is not None:
                line += [
                    f"--{option.replace('_', '-')}",
                    f"{value:g}" if isinstance(value, float) else str(value),
                ]
    return shlex.join(line)
