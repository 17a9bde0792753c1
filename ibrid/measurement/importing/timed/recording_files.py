"""Files of recordings: which files are one recording, and the tables in them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.formats import bundle
from ibrid.measurement.formats.files import read_bytes
from ibrid.measurement.formats.guarded import guarded
from ibrid.measurement.importing.binary.psout_file import REMARKS, psout_arrays
from ibrid.measurement.importing.foreign_table import ForeignTable, array_table
from ibrid.measurement.importing.numbers.number_format import UNSAID, NumberFormat
from ibrid.measurement.importing.table_files import read_tables
from ibrid.measurement.importing.timed.pscad_output import is_pscad_output, pscad_table, run_of
from ibrid.measurement.importing.timed.scopes import scope_table, timeseries_table

PSOUT = ".psout"
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
        stem = file.with_suffix("").as_posix().lower()
        if file.suffix.lower() in _WITH_CONFIGURATION and stem in known:
            continue
        of_run = (
            is_pscad_output(file) if file.suffix.lower() in (".out", ".inf", ".infx") else False
        )
        kept.setdefault(f"{file.parent}/{run_of(file)}/pscad" if of_run else str(file), file)
    if not kept:
        raise SweepError("a file with numbers must be named; found none.")
    return list(kept.values())
