"""One door for all sweep files: the suffix, and where that leaves doubt the first line, choose the
reader.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError
from ibrid.measurement.formats.bundle import ENDINGS, suffix_of
from ibrid.measurement.formats.csv_file import read_csv
from ibrid.measurement.formats.files import first_line, read_bytes
from ibrid.measurement.formats.pscad import pscad_response
from ibrid.measurement.formats.state_space_file import SCHEMA, read_state_space_file
from ibrid.measurement.formats.touchstone import TOUCHSTONE, touchstone_response
from ibrid.measurement.frames import sweep_of_data
from ibrid.measurement.importing.importing import import_files
from ibrid.measurement.importing.matlab import read_mat
from ibrid.measurement.importing.table_files import json_model
from ibrid.measurement.sweeps.sweep import Sweep

_BINARY = {
    ".xls": "a spreadsheet",
    ".xlsx": "a spreadsheet",
    ".ods": "a spreadsheet",
    ".psout": "PSCAD output",
}


def read_arrays(path: Path, frequency: np.ndarray | None = None, **keys: Any) -> Sweep:
    """The sweep in a file of arrays by name, which may be a state space; SweepError with all that
    must be said beside it.
    """
    return import_files([path], frequency=frequency, **keys).answered()


def read_model(path: Path, frequency: np.ndarray | None = None, **keys: Any) -> Sweep:
    """The sweep of a model in JSON, an exported one or plain matrices A, B, C, D."""
    content = read_bytes(path)
    if SCHEMA.encode() not in content and json_model(content):
        return read_arrays(path, frequency, **keys)
    return read_state_space_file(path, frequency, **keys)


_READERS = {".mat": read_mat, ".json": read_model, ".npz": read_arrays}


@takes_kinds
def read_sweep(path: Any, *, frequency: np.ndarray | None = None, **keys: Any) -> Sweep:
    """Read measured dq admittances, in whatever form, as per unit, current out of the inverter, q
    axis leading.

    path : a file, a DataFrame (of pandas or alike), or a tuple (frequency in Hz, matrices (K, 2,
    2)) with p= and q=. A DataFrame
        whose columns are not those of a sweep file is read as `ibrid import` reads a table, with
        its options as keys (unit, base, current, map, ..).

    CSV (read_csv), MATLAB .mat (read_mat), Touchstone .s2p .y2p .z2p (touchstone_response), Z-tool
    text and IMTB CSV (pscad_response), an exported model .json (read_state_space_file). For
    python-control objects: from_frd, from_system, from_responses.

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
    path = Path(path)
    suffix = path.suffix.lower()
    suffix = suffix_of(path) if suffix in ENDINGS else suffix
    if suffix in _READERS:
        at = None if frequency is None else np.asarray(frequency, dtype=float)
        return _READERS[suffix](path, at, **keys)
    if suffix in _BINARY and path.is_file():
        raise SweepError(
            f"{path} must be a sweep; found {_BINARY[suffix]}, save the table as CSV, or let ibrid "
            "import read it."
        )
    if suffix == ".py":
        raise SweepError(
            f"{path} must be a sweep; found a program, which a command takes before the data: "
            "MODEL DATA."
        )
    response = touchstone_response(path) if suffix in TOUCHSTONE else pscad_response(path)
    return read_csv(path, **keys) if response is None else response.sweep(path, keys)


def is_own_sweep(path: Path) -> bool:
    """Whether a file has the columns of a sweep file of ours."""
    return {"op", "p", "q", "freq_hz"} <= {name.strip() for name in first_line(path).split(",")}


def is_sweep_file(path: Path) -> bool:
    """Whether ibrid import wrote a file."""
    return first_line(path).startswith("op,p,q,") and read_bytes(path).startswith(
        b"# imported from "
    )
