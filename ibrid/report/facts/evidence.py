"""What a page is evidence of: the version, the command as it was written, and the files that it
read, by their hashes. Nothing of it depends on when or where the command ran.
"""

import re
import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import file_digest, sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ibrid.own_files import changed_since_read, command_at_work

#: Options that say where an answer goes and on how many cores it is made, not what it is; with and
#: without a value.
_PLACES = ("--out", "--json", "--report", "--picture", "--workers", "--ray", "--equivalent")
_FLAGS = ("--overwrite", "--resume", "--quiet")
#: Name and password in an address.
_CREDENTIALS = re.compile(r"(?<=://)[^/@\s]*@")
#: Files that are listed.
MOST_FILES = 12


@dataclass(frozen=True)
class FileRead:
    """What the command calls a file, its name, and its SHA-256; "" where it was changed since it
    was read.
    """

    called: str
    name: str
    sha256: str


@dataclass(frozen=True)
class Evidence:
    """command : "" where no command is at work, as in Python. more_files : how many are not listed.
    model : SHA-256 of the program text of the model that the page shows, "" without one.
    """

    version: str
    command: str
    files: tuple[FileRead, ...]
    more_files: int
    model: str


def evidence_now(program: str = "") -> Evidence:
    """What the command at work has read so far, and the hash of the model's program."""
    words, inputs = command_at_work()
    files: dict[Path, FileRead] = {}
    not_listed = set()
    for called, place in sorted(inputs.items()):
        path = Path(place)
        if path.absolute() in files:
            continue
        if len(files) == MOST_FILES:
            not_listed.add(path.absolute())
        else:
            with suppress(OSError), path.open("rb") as stream:
                digest = file_digest(stream, "sha256").hexdigest()
                if changed_since_read(path):
                    digest = ""
                files[path.absolute()] = FileRead(called, path.name, digest)
    return Evidence(
        _version(),
        command_line(words),
        tuple(files.values()),
        len(not_listed),
        sha256(program.encode()).hexdigest() if program else "",
    )


def command_line(words: Sequence[str]) -> str:
    """The command as it can be written again, without what says only where its answer goes."""
    kept = []
    is_value = False
    for word in words:
        option = word.split("=", 1)[0]
        if is_value and not word.startswith("--"):
            is_value = False
            continue
        is_value = option in _PLACES and "=" not in word
        if option not in (*_PLACES, *_FLAGS):
            kept.append(_CREDENTIALS.sub("", word))
    return shlex.join(["ibrid", *kept]) if kept else ""


def _version() -> str:
    try:
        return version("ibrid")
    except PackageNotFoundError:  # a folder of source code that nobody installed
        return "without a version"
