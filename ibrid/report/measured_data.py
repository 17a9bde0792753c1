"""The measurement behind a record: given, or read again from where the record says it was."""

from os.path import isfile

import numpy as np

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweep import PointSweep, Sweep

#: Relative difference of an NRMSE above which the data are not those of the record.
SAME = 1e-3
#: Differences of NRMSE below this are rounding.
ROUNDING = 1e-9


def measured_data(record: Record, sweep: Sweep | None) -> tuple[Sweep | None, str]:
    """The sweep to show, if there is one, and a sentence about it, "" when all is as it should be."""
    if sweep is None:
        path = str(record.settings.get("data") or "")
        if not isfile(path):  # unlike a Path it bears any text
            missing = f"the data file {path} is not there" if path else "the record does not say where its data are"
            return None, f"Only model lines are shown: {missing}; give the sweep to show the measured dots."
        try:
            sweep = read_sweep(path)
        except IbridError as problem:
            return None, f"Only model lines are shown: the data cannot be read again ({problem})"
    return sweep, _doubt(record, sweep)


def _doubt(record: Record, sweep: Sweep) -> str:
    """Whether the sweep gives the errors that the record states."""
    missing = [name for name in record.parameters if name not in sweep.names]
    if missing:
        return f"The data shown lack the operating points {', '.join(missing)}; they may have changed since the fit."
    for name, stated in {**record.nrmse_by_op, **record.holdout}.items():
        try:
            found = _nrmse(record, sweep.point(name))
        except IbridError:
            return ""
        if abs(found - stated) > SAME * stated + ROUNDING:
            return (
                f"The dots are not those that were fitted: at {name} they give an NRMSE of {found:.3g}, the record "
                f"states {stated:.3g}; the file has changed, or was read with other options."
            )
    return ""


def _nrmse(record: Record, point: PointSweep) -> float:
    model = record.response(point.op.name, point.frequency)
    return float(np.linalg.norm(model - point.admittance) / np.linalg.norm(point.admittance))
