"""One operating point from a frequency response that came without columns for its steady state."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conventions.conversions import Quantity, to_ours
from ibrid.measurement.conventions.header import (
    CHOICES,
    HEADER_KEYS,
    POINT_KEYS,
    header_of,
    known_keys,
    point_of,
    read_keys,
)
from ibrid.measurement.formats.bundle import is_there
from ibrid.measurement.formats.files import read_lines
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

SIDECAR = ".meta"


@dataclass(frozen=True, eq=False)
class Response:
    """A file of a known make: one operating point.

    `told` : header keys and op, p, q, v that the file, its make or its `.meta` says; None: must be
    said. `name` : of the operating point where nobody names it.
    """

    frequency: np.ndarray
    matrix: np.ndarray
    quantity: Quantity
    told: Mapping[str, object]
    notes: tuple[str, ...]
    name: str

    def sweep(self, path: Path, keys: Mapping[str, object]) -> Sweep:
        """With what else is said, which wins."""
        said = {**self.told, **known_keys(keys)}
        if said.get("current", "") is None:
            raise SweepError(
                f"{path} must come with current: in or out (of the device); add it to {path}.meta."
            )
        return sweep_of_response(
            self.frequency, self.matrix, said, str(path), self.quantity, self.notes, self.name
        )


def sweep_of_response(
    frequency: np.ndarray,
    matrix: np.ndarray,
    keys: Mapping[str, object],
    where: str,
    quantity: Quantity | None = None,
    notes: tuple[str, ...] = (),
    default_name: str = "op",
) -> Sweep:
    """A sweep of one operating point, converted to our convention.

    Parameters
    ----------
    frequency : (K,) Hz, in any order.
    matrix : complex, (K, 2, 2).
    keys : header keys (f0_hz, unit, current, q_axis, power_node, s_base_va, v_base_v, sampling_hz)
    and op, p, q, v.
    where : file or description, for errors and as the sweep's source.

    Raises SweepError: p or q missing; frequencies not positive or twice; numbers not finite; bases
    missing.
    """
    header = header_of(keys, where, notes)
    op = point_of(keys, where, default_name)
    frequency, matrix = np.asarray(frequency, float), np.asarray(matrix, complex)
    if not len(frequency):
        raise SweepError(f"{where} must hold at least one frequency; found none.")
    if not np.isfinite(frequency).all() or not np.isfinite(matrix).all():
        raise SweepError(
            f"{where} must hold finite numbers; found NaN or infinity, remove those frequencies."
        )
    if (frequency <= 0).any():
        raise SweepError(
            f"{where}: frequencies must be positive; found {frequency.min():g} Hz, leave it out "
            "(in dq a negative frequency is the conjugate of the positive one)."
        )
    order = np.argsort(frequency, kind="stable")
    frequency, matrix = frequency[order], matrix[order]
    twice = np.flatnonzero(np.diff(frequency) == 0)
    if len(twice):
        raise SweepError(
            f"{where}: each frequency must be there once; found {frequency[twice[0]]:g} Hz twice."
        )
    matrix, _ = to_ours(
        matrix, None, header, quantity or Quantity(), lambda k: f"{where} at {frequency[k]:g} Hz"
    )
    try:
        point = PointSweep(op, frequency, matrix)
    except SweepError as reason:
        raise SweepError(f"{where}: {reason}") from reason
    return header.sweep([point], where)


def sidecar_keys(
    path: Path,
    known: Iterable[str] = HEADER_KEYS + POINT_KEYS,
    choices: Mapping[str, tuple[str, ...]] = CHOICES,
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Keys and notes of `<path>.meta`, a text file of `key: value` lines (# may lead); empty
    without one.
    """
    sidecar = Path(f"{path}{SIDECAR}")
    if not is_there(sidecar):
        return {}, ()
    lines = [
        (number, line.strip().lstrip("#")) for number, line in enumerate(read_lines(sidecar), 1)
    ]
    return read_keys(lines, str(sidecar), known, choices)
