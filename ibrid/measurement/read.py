"""One door for all sweep files: the suffix, and where that leaves doubt the first line, choose the
reader.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError
from ibrid.measurement.conventions.header import HEADER_KEYS, POINT_KEYS
from ibrid.measurement.formats.bundle import ENDINGS, suffix_of
from ibrid.measurement.formats.csv_columns import SETPOINT
from ibrid.measurement.formats.csv_file import read_csv
from ibrid.measurement.formats.files import first_line, read_bytes
from ibrid.measurement.formats.pscad import pscad_response
from ibrid.measurement.formats.state_space_file import SCHEMA, read_state_space_file
from ibrid.measurement.formats.touchstone import TOUCHSTONE, touchstone_response
from ibrid.measurement.frames import sweep_of_data
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.importing.matlab import read_mat
from ibrid.measurement.importing.table_files import json_model
from ibrid.measurement.importing.told import base_of
from ibrid.measurement.importing.unsaid import UnsaidError
from ibrid.measurement.read_events import is_events_file
from ibrid.measurement.sweeps.sweep import Sweep


def read_table(path: Path, frequency: np.ndarray | None = None, **keys: Any) -> Sweep:
    """The sweep in anybody's table, or in arrays by name, which may be a state space; SweepError
    with all that must be said beside it. What was assumed is among its notes.
    """
    maps = keys.pop("map", ())
    maps = [maps] if isinstance(maps, str) else maps
    return import_files([path], maps, frequency, **keys).answered()


def read_model(path: Path, frequency: np.ndarray | None = None, **keys: Any) -> Sweep:
    """The sweep of a model in JSON, an exported one or plain matrices A, B, C, D."""
    content = read_bytes(path)
    if SCHEMA.encode() not in content and json_model(content):
        return read_table(path, frequency, **keys)
    return read_state_space_file(path, frequency, **keys)


_READERS = {".mat": read_mat, ".json": read_model, ".npz": read_table}
#: Endings of tables that are no text.
_TABLES = (".xls", ".xlsx", ".xlsm", ".ods", ".parquet", ".h5", ".hdf5", ".psout")


@takes_kinds
def read_sweep(path: Any, *, frequency: np.ndarray | None = None, **keys: Any) -> Sweep:
    """Read measured dq admittances, in whatever form, as per unit, current out of the inverter, q
    axis leading.

    path : a file, a DataFrame (of pandas or alike), or a tuple (frequency in Hz, matrices (K, 2,
    2)) with p= and q=. A table,
        DataFrame or file, whose columns are not those of a sweep file is read as `ibrid import`
        reads it, with its options as keys (unit, base, current, map, ..).

    CSV (read_csv), MATLAB .mat (read_mat), Touchstone .s2p .y2p .z2p (touchstone_response), Z-tool
    text and IMTB CSV (pscad_response), an exported model .json (read_state_space_file), tables as
    text, xlsx, ods, Parquet, HDF5 or NPZ. For python-control objects: from_frd, from_system,
    from_responses.

    frequency : (K,) Hz at which a state space is sampled (by default from a fifth of its slowest
    pole on, ours from 5 to 5000 Hz); what was measured has its own.
    keys : what the file does not say about itself or says wrongly: f0_hz, unit, current, q_axis,
    voltage_axis,
        frame_deg, power_node, s_base_va, v_base_v, sampling_hz; where the format has no columns for
        it also op, p, q, v. They win over the file. Formats other than the CSV also look into
        `<path>.meta`, lines `key: value`.

    Raises SweepError: one sentence with file and line.
    """
    if not isinstance(path, str | Path):
        return sweep_of_data(path, keys)
    if base := keys.pop("base", None):
        keys["s_base_va"], keys["v_base_v"] = base_of(base, "base")
    path = Path(path)
    suffix = path.suffix.lower()
    suffix = suffix_of(path) if suffix in ENDINGS else suffix
    at = None if frequency is None else np.asarray(frequency, dtype=float)
    if suffix in _READERS:
        return _READERS[suffix](path, at, **keys)
    if suffix == ".py":
        raise SweepError(
            f"{path} must be a sweep; found a program, which a command takes before the data: "
            "MODEL DATA."
        )
    first = None
    if suffix not in _TABLES and keys.keys() <= {*HEADER_KEYS, *POINT_KEYS}:
        response = touchstone_response(path) if suffix in TOUCHSTONE else pscad_response(path)
        try:
            return read_csv(path, **keys) if response is None else response.sweep(path, keys)
        except SweepError as reason:
            ours = is_own_sweep(path) or first_line(path).startswith("op,p,q,")
            if response is not None or ours:
                raise
            first = reason
    if is_events_file(path):
        raise SweepError(
            f"{path} holds records of events, and a sweep is needed; read them with "
            "ibrid.read_events, fit them with ibrid.evaluate_events"
        )
    try:
        return read_table(path, at, **keys)
    except UnsaidError:
        raise
    except SweepError as reason:
        raise (reason if first is None or _has_foreign_header(path) else first) from None


def is_own_sweep(path: Path) -> bool:
    """Whether a file has the columns of a sweep file of ours."""
    return {*SETPOINT} <= {name.strip() for name in first_line(path).split(",")}


def _has_foreign_header(path: Path) -> bool:
    """Whether the first line of a text has several words, and two or more of the first columns of a
    sweep file of ours are not among them, whatever separates them.
    """
    words = re.split(r"[,;|\s]+", first_line(path))
    return len(words) > 1 and len({*SETPOINT} - {*words}) > 1


def is_sweep_file(path: Path) -> bool:
    """Whether ibrid import wrote a file."""
    return first_line(path).startswith("op,p,q,") and read_bytes(path).startswith(
        b"# imported from "
    )
