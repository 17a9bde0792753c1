"""The answer beside measurements that no fit saw: its errors, and figures of both."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.analysis.models.prediction import predict
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import PointSweep
from ibrid.playback.compare import model_of_record, play
from ibrid.report.figures.bode import Curves, bode_svgs
from ibrid.report.pages.playback_page import record_svg


def prediction_error(answer: Record, file: Path, kind: str) -> float:
    """Return |model - measurement| / |measurement| of a sweep, the NRMSE of a record of an event.

    Raises IbridError where the model has no rest there, or leaves.
    """
    if kind == "event":
        return played_error(answer, read_events(file))
    point = read_sweep(file).points[0]
    apart = _predicted(answer, point) - point.admittance
    return float(np.linalg.norm(apart) / np.linalg.norm(point.admittance))


def played_error(answer: Record, events: Events) -> float:
    """Return the NRMSE of the first record.

    Raises IbridError where the model has no rest there, or leaves.
    """
    played = play(model_of_record(answer), events).records[0]
    if played.nrmse is None or not np.isfinite(played.nrmse):
        raise IbridError(f"it does not hold out in {played.record.name}")
    return played.nrmse


def prediction_figures(
    answer: Record, held_out: Mapping[str, Mapping[str, Any]], folder: Path
) -> dict[str, Any]:
    """Draw held-out experiments that were measured: `bode` by entry, `events` as (name, figure)."""
    figures: dict[str, Any] = {"bode": None, "point": "", "events": []}
    for name, experiment in held_out.items():
        if experiment["nrmse"] is None:
            continue
        file = folder / experiment["file"]
        if name == "sweep":
            point = read_sweep(file).points[0]
            shown = Curves(point.op.name, 0, point, point.frequency, _predicted(answer, point))
            label = f", magnitude and phase over frequency, at {point.op.name}, held out."
            figures["bode"] = bode_svgs([shown], "held-bode", label)
            figures["point"] = point.op.name
        else:
            model = model_of_record(answer)
            played = play(model, read_events(file)).records[0]
            svg = record_svg(f"held-{name}", played, {"model": played.current}, model.values)
            figures["events"].append((played.record.name, svg))
    return figures


def _predicted(answer: Record, point: PointSweep) -> np.ndarray:
    """(K, 2, 2) of the model at an operating point that it was not fitted at."""
    op = replace(point.op, name=f"held out {point.op.name}")
    return predict(answer, op, point.frequency).admittance
