"""Evaluated steps beside each other, in plain data: all with their lineage, two compared, what one leaves in sigmas."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.evaluation.grade import judged_points
from ibrid.evaluation.record import Record
from ibrid.measurement.amplitudes import evenly
from ibrid.measurement.sweep import ENTRIES, Sweep
from ibrid.report.numbers import number
from ibrid_search.blocks import shown
from ibrid_search.step import Step
from ibrid_search.tool import left_out

#: Steps and frequencies that are shown at most, and parameters that moved.
STEPS, ROWS, MOVED = 20, 16, 12
#: Relative change of a parameter from which it counts as moved.
CHANGED = 0.02


def steps_view(steps: Sequence[Step], after: int = -1) -> dict[str, Any]:
    """Steps with a number above `after` in their order, refused ones too: parent, note and how they ended."""
    there = [step for step in steps if step.number > after]
    told = [_told(step) for step in there[:STEPS]]
    if left := left_out("steps", len(told), len(there)):
        left["go_on_after"] = told[-1]["step"]
    return {"steps": told, **left}


def differences(first: Record, second: Record) -> dict[str, Any]:
    """What the second of two fits has better or worse than the first: error, size, and parameters that moved."""
    pairs = {
        "nrmse": (first.nrmse, second.nrmse),
        "free_parameters": (first.free_parameters, second.free_parameters),
        "order": (first.order, second.order),
        **{
            f"nrmse {band} Hz": (first.nrmse_by_band.get(band), second.nrmse_by_band.get(band))
            for band in first.nrmse_by_band
        },
        **{f"nrmse {entry}": (first.nrmse_by_entry.get(entry), second.nrmse_by_entry.get(entry)) for entry in ENTRIES},
    }
    before, after = (next(iter(one.parameters.values()), {}) for one in (first, second))
    moved = {
        name: f"{number(before[name])} -> {number(value)}"
        for name, value in after.items()
        if name in before and abs(value - before[name]) > CHANGED * abs(before[name])
    }
    return {
        "first_then_second": {name: list(pair) for name, pair in pairs.items() if pair[0] != pair[1]},
        "moved": dict(list(moved.items())[:MOVED]),
        **left_out("moved", MOVED, len(moved)),
    }


def residuals_view(record: Record, sweep: Sweep, op: str | None = None) -> dict[str, Any]:
    """What a fit leaves at an operating point in standard deviations of the noise, |model - measured| / (sqrt(2) sigma), by
    frequency and entry; parts that stand out are those of the record's `misfit`. Raises IbridError for an unknown point."""
    names = tuple(record.nrmse_by_op)
    if op is not None and op not in names:
        raise IbridError(f"the fitted data have no operating point {op[:60]!r}; {near(op[:60], names)}")
    points, source = judged_points([sweep.point(name) for name in names])
    point = points[names.index(op) if op else 0]
    left = np.abs(record.response(point.op.name, point.frequency) - point.admittance) / (
        np.sqrt(2) * np.asarray(point.sigma)
    )
    chosen = evenly(len(left), ROWS)
    misfit = record.misfit or {}
    return {
        "op": point.op.name,
        "sigma_from": source if source != "unknown" else "unknown: taken as 1e-4 of |Y|",
        "chi2_per_dof": misfit.get("chi2_per_dof"),
        "stand_out": [
            f"{one['z']:.0f} sigma: {one['entry']} at {one['band']} Hz, {one['op']}"
            for one in misfit.get("by_entry_band", ())
        ][:ROWS],
        "rows": [
            {"hz": round(float(point.frequency[k]), 2)}
            | {entry: round(float(left[k][place]), 1) for entry, place in ENTRIES.items()}
            for k in chosen
        ],
        **left_out("rows", len(chosen), len(left)),
    }


def _told(step: Step) -> dict[str, Any]:
    ended: dict[str, Any] = {"step": step.number, "status": str(step.status)}
    if step.parent is not None:
        ended["parent"] = step.parent
    if step.note:
        ended["note"] = shown(step.note)
    if step.nrmse is not None:
        ended |= {"nrmse": step.nrmse, "free": step.free} | ({} if step.stable else {"stable": False})
    return ended | ({"same_as": step.same_as} if step.same_as is not None else {})
