"""The admittance of a model on a frequency grid, as a sweep: per unit, current out, q leading, delays exact."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ibrid.analysis.linear_model import whole_record, with_point
from ibrid.evaluation.record import Record
from ibrid.measurement.csv_file import write_sweep
from ibrid.measurement.frd import MODEL_GRID
from ibrid.measurement.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.measurement.touchstone import write_touchstone


def admittance(record: Record, op: str | None = None, frequency: np.ndarray | None = None) -> Sweep:
    """What a noiseless measurement of a record's model would give, in the frame of the PCC voltage.

    op : as in `linear_model`. frequency : (K,) Hz, ascending, by default `MODEL_GRID`.

    Raises OperatingPointError and IbridError as `linear_model`, SweepError for a grid that is none.
    """
    with whole_record():
        whole, name = with_point(record, op)
        point = whole.settings["operating_points"][name]
        grid = MODEL_GRID if frequency is None else np.asarray(frequency, dtype=float)
        at = OperatingPoint(name, float(point["p"]), float(point["q"]), float(point["v"]))
        return Sweep(
            points=(PointSweep(at, grid, whole.response(name, grid)),),
            f0_hz=float(whole.settings["f0_hz"]),
            power_node=whole.settings["power_node"],
            source="a fitted model",
        )


def _write_csv(sweep: Sweep, path: str | Path) -> None:
    write_sweep(sweep, path, header=("admittance of a fitted model, not a measurement; delays are exact",))


def _write_touchstone(sweep: Sweep, path: str | Path) -> None:
    write_touchstone(sweep, path, sweep.names[0])


#: Formats of the admittance: name -> function that writes a sweep of one operating point.
ADMITTANCE_FORMATS: Mapping[str, Callable[[Sweep, str | Path], None]] = MappingProxyType(
    {"csv": _write_csv, "touchstone": _write_touchstone}
)
