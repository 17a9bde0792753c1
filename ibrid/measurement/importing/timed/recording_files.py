"""Files of recordings: which files are one recording, and the tables in them."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from ibrid.errors import SweepError, some
from ibrid.measurement.formats import bundle
from ibrid.measurement.formats.files import read_bytes
from ibrid.measurement.formats.guarded import guarded
from ibrid.measurement.importing.binary.psout_file import REMARKS, psout_arrays
from ibrid.measurement.importing.column_words import entry_named, meaning_of
from ibrid.measurement.importing.foreign_table import ForeignTable, array_table
from ibrid.measurement.importing.numbers.number_format import UNSAID, NumberFormat
from ibrid.measurement.importing.table_files import read_tables
from ibrid.measurement.importing.timed.families import signals_of
from ibrid.measurement.importing.timed.pscad_output import is_pscad_output, pscad_table, run_of
from ibrid.measurement.importing.timed.scopes import scope_table, timeseries_table
from ibrid.measurement.importing.timed.signal_names import size_of, split_unit

PSOUT = ".psout"
#: Files with a channel each of which a recording is made: two voltages, two currents.
FEWEST_CHANNELS = 4
_WORD = re.compile(r"[^\W_]+")
#: Of a COMTRADE record: what is read with its configuration.
_WITH_CONFIGURATION = (".dat", ".hdr", ".inf")


def recording_tables(path: Path, form: NumberFormat = UNSAID) -> list[ForeignTable]:
    """The tables of a file that may hold recordings; SweepError says why there is none."""
    if is_pscad_output(path):
        return [pscad_table(path)]
    if bundle.suffix_of(path) == PSOUT:
        arrays = guarded(psout_arrays, read_bytes(path), f"{path} must be output of PSCAD")
        remarks = arrays.pop(REMARKS, np.zeros(0, dtype=str)).tolist()
        table = array_table(arrays, str(path), bundle.stem_of(path))
        return [replace(table, remarks=(*table.remarks, *remarks))]
    tables = read_tables(path, form=form)
    one = scope_table(tables) if len(tables) > 1 else timeseries_table(tables[0])
    return tables if one is None else [one]


def channels_apart(paths: Sequence[Path], form: NumberFormat = UNSAID) -> ForeignTable | None:
    """The recording of `joined_channels`; None for other files."""
    with suppress(SweepError):
        return joined_channels(paths, form)
    return None


def joined_channels(paths: Sequence[Path], form: NumberFormat = UNSAID) -> ForeignTable:
    """The channels of one recording that an oscilloscope saved as files of their own, each with a
    time and a value, side by side and called as the files are.

    form : how numbers are written. Raises SweepError that says why the files are no such recording.
    """
    if len(paths) < FEWEST_CHANNELS:
        raise SweepError(
            f"files of one recording with a channel each must be {FEWEST_CHANNELS} at least; found "
            f"{len(paths)}, read them one by one."
        )
    held: list[tuple[ForeignTable, str, np.ndarray]] = []
    time = np.zeros(0)
    for path in paths:
        table, *more = read_tables(path, form=form)
        whole = [
            (name, column)
            for name, column in table.columns.items()
            if column.dtype.kind == "f" and np.isfinite(column).all()
        ]
        of_sweep = entry_named(table.stem) or (whole and meaning_of(whole[0][0]).role)
        if more or len(whole) != 2 or of_sweep:
            raise SweepError(
                f"{path} must hold a time and one channel, as each of several files of one "
                f"recording; found {some(list(table.columns))}, read the files one by one."
            )
        (_, grid), (name, values) = whole
        time = time if held else grid
        if not np.array_equal(time, grid) or (np.diff(grid) <= 0).any():
            raise SweepError(
                f"{path} must hold a channel at rising times, at the same times as {paths[0]}; "
                "found others, read the files one by one."
            )
        unit = name if size_of(name) else split_unit(name)[1]
        held.append((table, f" [{unit}]" if unit else "", values))
    stems, first = [table.stem for table, _, _ in held], held[0][0]
    if len({*stems}) < len(stems):
        raise SweepError(
            f"files of one recording must be called as their channels are; found {some(stems)}, "
            "give each a name of its own."
        )
    names = _names_of_channels(stems)
    columns = {"t [s]": time} | {
        f"{name}{unit}": values for name, (_, unit, values) in zip(names, held, strict=True)
    }
    remark = f"{len(paths)} files with a channel each are one recording: {some(stems)}"
    return replace(
        first,
        where=f"{first.where} and others",
        stem=_common_name(stems),
        columns=columns,
        remarks=(remark,),
    )


def _common_name(stems: Sequence[str]) -> str:
    """The words in which the names of files agree, else how all begin; the first name where they
    have nothing in common.
    """
    words = [_WORD.findall(stem) for stem in stems]
    alike = [at[0] for at in zip(*words, strict=False) if len({*at}) == 1]
    begin = takewhile(lambda at: len({*at}) == 1, zip(*stems, strict=False))
    return "_".join(alike) or "".join(at[0] for at in begin).strip("_- ") or stems[0]


def _names_of_channels(stems: Sequence[str]) -> list[str]:
    """What differs in the names of files: the part that names a signal in each, else all of it."""
    words = [_WORD.findall(stem) for stem in stems]
    if len({*map(len, words)}) > 1:
        return list(stems)
    at_places = list(zip(*words, strict=True))
    apart = [k for k, at in enumerate(at_places) if len({*at}) > 1]
    middles = ["_".join(one[apart[0] : apart[-1] + 1]) for one in words]
    for names in (middles, *at_places):
        if len({signal.role for signal in signals_of(names)} - {""}) == len(stems):
            return list(names)
    return list(stems)


def each_once(paths: Sequence[Path]) -> list[Path]:
    """The files to read of those named: archives opened, of one recording in several files the
    first alone.

    Raises SweepError for an archive that is none.
    """
    files = [file for path in paths for file in bundle.files_in(path)]
    known = {
        file.with_suffix("").as_posix().lower() for file in files if file.suffix.lower() == ".cfg"
    }
    kept: dict[str, Path] = {}
    for file in files:
        stem = (file.parent / file.stem).as_posix().lower()
        if file.suffix.lower() in _WITH_CONFIGURATION and stem in known:
            continue
        of_run = (
            is_pscad_output(file) if file.suffix.lower() in (".out", ".inf", ".infx") else False
        )
        kept.setdefault(f"{file.parent}/{run_of(file)}/pscad" if of_run else str(file), file)
    if not kept:
        raise SweepError("a file with numbers must be named; found none.")
    return list(kept.values())
