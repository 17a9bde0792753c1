"""Where answers go: JSON to a file or, for "-", to the terminal; sentences about a wrong input to the error stream."""

import os
import shlex
import sys
from argparse import Namespace
from collections.abc import Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.writing import json_lines, require_place, write_whole

TERMINAL = "-"
#: Exit status of a command that a limit ended before it was finished; what was found is kept.
UNFINISHED = 3
#: The same of one that Ctrl-C ended.
INTERRUPTED = 130


def require_json_place(where: str | None) -> None:
    """Raise IbridError before any work when `--json OUT` cannot be written."""
    if where is not None and where != TERMINAL:
        require_place(where)


def require_distinct(outputs: Mapping[str, str | Path | None], inputs: Mapping[str, str | Path | None]) -> None:
    """Raise IbridError before any work when an output is the file of an input or of another output.

    outputs, inputs : what the user calls it, such as "--json" or "DATA" -> path. None, the terminal, devices and names
    of shipped things, which are no files, pass.
    """
    written = {
        name: path for name, path in outputs.items() if path is not None and not (name == "--json" and path == TERMINAL)
    }
    read = {name: path for name, path in inputs.items() if path is not None and os.path.isfile(path)}
    for (name, path), (other, taken) in product(written.items(), read.items()):
        if _same_file(path, taken):
            raise IbridError(f"{name} {path}: would overwrite {other}, the same file; choose another place")
    for (other, taken), (name, path) in combinations(written.items(), 2):
        if _same_file(path, taken):
            raise IbridError(f"{other} and {name} must be two files, found {path} for both; rename one")


def _same_file(path: str | Path, other: str | Path) -> bool:
    try:
        if os.path.exists(path) and os.path.exists(other):
            return os.path.samefile(path, other) and os.path.isfile(path)
        return os.path.realpath(path) == os.path.realpath(other)
    except (OSError, ValueError):  # a name that no file can have: refused where it is opened
        return False


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


def command_line(arguments: Namespace, *words: str, options: Sequence[str]) -> str:
    """The command line that makes the same numbers again; an option is there for each of its values."""
    line = ["ibrid", *words]
    for option in options:
        given = getattr(arguments, option)
        for value in given if isinstance(given, list) else [given]:
            if value is not None:
                line += [f"--{option.replace('_', '-')}", f"{value:g}" if isinstance(value, float) else str(value)]
    return shlex.join(line)


def complain(sentence: str) -> None:
    """One line on the error stream."""
    if sys.stderr is not None:  # closed by the caller
        print(f"ibrid: {' '.join(sentence.split())}", file=sys.stderr)
