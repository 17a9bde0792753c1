"""What the repaired model says of an operating point that nobody showed it."""

from dataclasses import replace

import numpy as np
from ibrid_bench.hidden.case import Case

from ibrid.errors import IbridError
from ibrid.evaluation.errors_by_part import nrmse
from ibrid.evaluation.record import Record
from ibrid.gap.refitting.noise import LEAST_UNKNOWN
from ibrid.measurement.conventions.rotation import rotation
from ibrid.measurement.sweeps.sweep import OperatingPoint, Sweep

#: Error over the noise floor that still counts as only noise.
MOST = 1.5


def held_out_ratio(record: Record, case: Case) -> float | None:
    """NRMSE at the clean held-out point over the noise floor of the measurement; None where the
    model has no answer there.
    """
    (point,) = case.held_out.points
    try:
        error = nrmse(predicted(record, point.op, point.frequency), point)
    except IbridError:
        return None
    return round(error / noise_floor(case.sweep), 4) if np.isfinite(error) else None


def predicted(record: Record, op: OperatingPoint, frequency: np.ndarray) -> np.ndarray:
    """Admittance (K, 2, 2) at any operating point from a record with shared parameters, in the
    frame of its data.
    """
    values = next(iter(record.parameters.values()))
    points = {op.name: {"p": op.p, "q": op.q, "v": op.v}}
    there = replace(
        record,
        parameters={op.name: values},
        settings={**record.settings, "operating_points": points},
    )
    turn = rotation(record.settings.get("frame_angle", 0.0))
    return turn @ there.response(op.name, frequency) @ turn.T


def noise_floor(sweep: Sweep) -> float:
    """NRMSE that noise alone leaves, mean over operating points; of clean data what a model is
    forgiven anyway.
    """
    levels = [
        LEAST_UNKNOWN
        if one.sigma is None
        else np.sqrt(2) * np.linalg.norm(one.sigma) / np.linalg.norm(one.admittance)
        for one in sweep.points
    ]
    return float(np.mean(levels))
