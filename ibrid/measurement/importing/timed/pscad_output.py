"""PSCAD's output as text: `run_01.out`, `run_02.out`, time and ten channels each, whose names and
units stand in `run.inf`.

`.inf` holds lines `PGB(7) Output Desc="Va" Group="Main" Max=.. Min=.. Units="kV"`; `.infx` the same
as XML.
"""

import re
from collections.abc import Mapping
from html import unescape
from pathlib import Path

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.formats import bundle
from ibrid.measurement.formats.files import head_lines, read_lines
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.own_files import announce

#: What describes the channels of a run, and what holds their numbers.
DESCRIBES, HOLDS = (".infx", ".inf"), (".out",)
#: Channels of a file, beside the time.
A_FILE = 10
_PART = re.compile(r"(.+)_(\d{2,})")
_RUN = re.compile(r"(.+)_r\d{3,}")
_LINE = re.compile(r"PGB\((\d+)\)(.*)", re.IGNORECASE)
_SAID = re.compile(r'([\w:]+)\s*=\s*"([^"]*)"')
_ELEMENT = re.compile(r"<(?:Analog|Digital|Signal|Output|Channel)\b([^<>]*)>", re.IGNORECASE)


def is_pscad_output(path: Path) -> bool:
    """Whether a file is output of PSCAD, or describes some.

    Where nothing describes it, a file that begins with names or a comment is another table.
    """
    suffix = bundle.suffix_of(path)
    if suffix in HOLDS:
        described = any(bundle.suffix_of(one) in DESCRIBES for one in _of_run(path))
        return described or not _begins_with_words(path)
    return suffix in DESCRIBES and any(bundle.suffix_of(one) in HOLDS for one in _of_run(path))


def _begins_with_words(path: Path) -> bool:
    """Whether the first cell of a file is no number; False where it cannot be read."""
    try:
        first = next((line for line in head_lines(path) if line.strip()), "0")
        float(first.split()[0])
    except SweepError:
        return False
    except ValueError:
        return True
    return False


def run_of(path: Path) -> str:
    """What the files of one run have in common."""
    stem = bundle.stem_of(path)
    matched = _PART.fullmatch(stem) if bundle.suffix_of(path) in HOLDS else None
    return matched[1] if matched else stem


def pscad_table(path: Path) -> ForeignTable:
    """All channels of the run to which a file belongs, in one table.

    Raises SweepError: nothing describes the channels, a file of the run is missing, or holds other
    numbers than are described.
    """
    announce(*(one for one in _of_run(path) if bundle.suffix_of(one) in HOLDS + DESCRIBES))
    parts = _parts(path)
    first = next(iter(parts.values()))
    described = _described(path)
    numbers = {number: _numbers(file) for number, file in parts.items()}
    names_above = _names_above(first) if not described else []
    if not described and not names_above:
        raise SweepError(
            f"{path} does not name its channels; copy {run_of(path)}.inf or .infx, which PSCAD "
            "writes beside it, into the folder."
        )
    time = next(iter(numbers.values()))[:, 0]
    columns: dict[str, np.ndarray] = {"TIME": time}
    for number, table in numbers.items():
        if len(table) != len(time):
            raise SweepError(
                f"{parts[number]} must have as many rows as {first.name}, {len(time)}; found "
                f"{len(table)}, is it cut off?"
            )
        for k in range(1, table.shape[1]):
            place = (number - 1) * A_FILE + k
            if described and place not in described:
                continue
            name = (
                described[place]
                if described
                else names_above[k]
                if k < len(names_above)
                else f"#{k + 1}"
            )
            columns[name if name not in columns else f"{name} #{place}"] = table[:, k]
    lacking = [name for place, name in described.items() if (place - 1) // A_FILE + 1 not in parts]
    remarks = (
        (f"{lacking[0]} and what stands behind it is in a file of the run that is not there",)
        if lacking
        else ()
    )
    return ForeignTable(
        str(path), run_of(path), columns, np.arange(1, len(time) + 1), remarks=remarks
    )


def _of_run(path: Path) -> list[Path]:
    run = run_of(path).lower()
    return [one for one in bundle.beside(path) if run_of(one).lower() == run]


def _parts(path: Path) -> dict[int, Path]:
    """Number of the file, from 1 -> its path."""
    files = [one for one in _of_run(path) if bundle.suffix_of(one) in HOLDS]
    parts: dict[int, Path] = {}
    for one in sorted(files):
        matched = _PART.fullmatch(bundle.stem_of(one))
        parts[int(matched[2]) if matched else 1] = one
    if not parts:
        raise SweepError(
            f"{path} must lie beside the .out files of the run; found none, copy them there."
        )
    return parts


def _described(path: Path) -> Mapping[int, str]:
    """Number of a channel, from 1 -> its name and unit; empty where no file describes the run."""
    run = run_of(path)
    plain = _RUN.fullmatch(run)
    for name in (run, plain[1] if plain else run):
        for suffix in DESCRIBES:
            for one in bundle.beside(path):
                if one.name.lower() == f"{name}{suffix}".lower():
                    text = "\n".join(read_lines(one))
                    return _from_xml(text) if suffix == ".infx" else _from_lines(text)
    return {}


def _from_lines(text: str) -> dict[int, str]:
    channels = {}
    for line in text.splitlines():
        if matched := _LINE.search(line):
            said = {key.lower(): value for key, value in _SAID.findall(matched[2])}
            channels[int(matched[1])] = _named(said)
    return channels


def _from_xml(text: str) -> dict[int, str]:
    """One channel for each element, as many as it has dimensions, in their order."""
    channels: dict[int, str] = {}
    for element in _ELEMENT.findall(text):
        said = {key.lower(): unescape(value) for key, value in _SAID.findall(element)}
        if "name" not in said and "desc" not in said:
            continue
        size = said.get("dim", said.get("dimension", "1"))
        count = int(size) if size.isdigit() and 0 < int(size) <= 1000 else 1
        for k in range(1, count + 1):
            channels[len(channels) + 1] = _named(said, f":{k}" * (count > 1))
    return channels


def _named(said: Mapping[str, str], behind: str = "") -> str:
    name = said.get("desc", said.get("name", "")).strip() + behind
    unit = said.get("units", said.get("unit", "")).strip()
    return f"{name} [{unit}]" if unit else name


def _names_above(path: Path) -> list[str]:
    """The names in the first line of a file that has them, `TIME V:1 V:2`."""
    words = next((line.split() for line in read_lines(path) if line.strip()), [])
    return words if words and words[0].lower().startswith("time") else []


def _numbers(path: Path) -> np.ndarray:
    """(n, channels + 1)"""
    lines = [line for line in read_lines(path) if line.strip()]
    begin = 0 if lines and _is_number(lines[0].split()[0]) else 1
    try:
        numbers = np.loadtxt(lines[begin:], ndmin=2)
    except ValueError as reason:
        raise SweepError(
            f"{path} must hold rows of numbers, time first; {reason}, is it cut off?"
        ) from None
    if numbers.size == 0 or numbers.shape[1] < 2:
        raise SweepError(f"{path} must hold rows of numbers, time first; found none.")
    return numbers


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
