"""A model fitted to records of events as a `Record`: of the sweep beside them, or of the linear
model itself.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.grade import CLOSE, ROUGH, Grade
from ibrid.evaluation.record import Record
from ibrid.fit.identifiability import Visibility, visible_by
from ibrid.gap.recordings.event_dataset import EventDataset
from ibrid.gap.recordings.event_fitter import EventFit
from ibrid.gap.recordings.event_noise import EventNoise
from ibrid.gap.recordings.event_problem import EventProblem
from ibrid.gap.refitting.model import Model
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.playback.compare import EventModel, Playback, play

#: Frequencies, Hz, at which a model that was fitted to events alone is described: so densely that
#: nobody looks for noise in them by vector fits.
DESCRIBED = np.geomspace(1.0, 2500.0, 52)
#: Singular values below this part of the largest are zero, of slopes that are differences.
NULL = 1e-6


def assess_identifiability(fit: EventFit) -> Visibility:
    """What the records, the sweep beside them and the prior tell together, and what they cannot
    see.
    """
    misfit = fit.misfit
    return visible_by(
        fit.jacobian,
        fit.x,
        misfit.coordinates,
        misfit.parameter_prior.names,
        misfit.noise.source,
        tolerance=NULL,
    )


def simulate_events(model: Model, data: EventDataset, events: Events) -> Playback:
    """What a model answers to every record."""
    return play(
        EventModel(model.diagram, model.refit.values, data.limits_of(model), data.kinds), events
    )


def mean_error(playback: Playback, held: Sequence[str]) -> float | None:
    """Of the records that are not held out; None where a simulation left."""
    errors = [one.nrmse for one in playback.records if one.record.name not in held]
    known = [one for one in errors if one is not None]
    return float(np.mean(known)) if known and len(known) == len(errors) else None


def noise_nrmse(noise: EventNoise) -> float:
    """NRMSE that noise and sampling alone would leave, the mean over the records."""
    return float(np.mean([*noise.floors.values()]))


def describe_linear_model(model: Model, data: EventDataset, events: Events) -> Sweep:
    """The linear model at the rest of each record, where nothing was swept."""
    frame = np.broadcast_to(np.eye(2, dtype=complex), (len(DESCRIBED), 2, 2))
    points = [
        OperatingPoint(one.name, one.rest.p, one.rest.q, one.rest.v) for one in events.records
    ]
    sweep = Sweep(
        tuple(PointSweep(op, DESCRIBED, frame) for op in points),
        f0_hz=events.f0_hz,
        power_node="pcc",
        source=events.source,
    )
    record = record_at(model.diagram, sweep, model.refit.values, vocabulary=data.kinds)
    answers = tuple(PointSweep(op, DESCRIBED, record.response(op.name, DESCRIBED)) for op in points)
    return replace(sweep, points=answers)


def record_of(model: Model, data: EventDataset, asked: EventProblem, playback: Playback) -> Record:
    """A record that predict and export accept, its errors and intervals those of all data
    together.
    """
    swept = asked.study or describe_linear_model(model, data, asked.events)
    record = record_at(
        model.diagram,
        swept,
        model.refit.values,
        **({} if asked.study else {"vocabulary": data.kinds}),
    )
    told = assess_identifiability(model.refit)
    variance = np.diag(told.covariance).clip(0.0, 1.0)
    spread = dict(
        zip(model.refit.misfit.parameter_prior.names, np.sqrt(variance).tolist(), strict=True)
    )
    limits = []
    for one in data.limits_of(model):
        values = {name: model.refit.values[f"{one.id}.{name}"] for name in one.parameters}
        deviations = {name: spread.get(f"{one.id}.{name}", 0.0) for name in one.parameters}
        limits.append({**one.plain(), "parameters": values, "deviations": deviations})
    fitted_to: dict[str, Any] = {"large_signal": limits, "events": asked.events.source}
    if asked.events.solver:
        fitted_to["events_solver"] = asked.events.solver
    by_record = {one.record.name: one.nrmse for one in playback.records if one.nrmse is not None}
    record = replace(
        record,
        settings={**record.settings, **fitted_to},
        nrmse_by_record=by_record,
        nrmse_by_window=playback.by_window,
        holdout={
            **record.holdout,
            **{name: by_record[name] for name in asked.held if name in by_record},
        },
        intervals={
            op: {name: told.intervals[name] for name in found}
            for op, found in record.intervals.items()
        },
        covariance=_covariance(record, model.refit, told),
        identifiability=told.sentences,
    )
    error = mean_error(playback, asked.held)
    floor = noise_nrmse(data.noise)
    grade = grade_recordings(error, floor, adequate=model.is_adequate())
    if asked.study is not None:
        return replace(
            record, grade=str(max(grade, Grade(record.grade or grade), key=list(Grade).index))
        )
    fitted = {name: value for name, value in by_record.items() if name not in asked.held}
    empty: dict[str, Any] = {
        name: {} for name in ("nrmse_by_band", "nrmse_by_entry", "share_by_band", "nrmse_by_part")
    }
    record = replace(
        record, nrmse=error, nrmse_by_op=fitted, grade=str(grade), noise_floor=floor, **empty
    )
    stated = all(one.sigma is not None for one in data.noise.events.records)
    noise_dof = {
        "value": floor,
        "from": "sigma" if stated else "repeats",
    }  # samples at rest repeat one number
    misfit = {
        "chi2_per_dof": model.refit.chi2 / model.refit.dof,
        "floor": noise_dof,
        "by_entry_band": [],
    }
    return replace(
        record,
        misfit=misfit,
        over_noise=float(np.sqrt(model.refit.chi2 / model.refit.misfit.count)),
    )


def grade_recordings(error: float | None, floor: float, *, adequate: bool) -> Grade:
    """The word for a mean NRMSE of records and the floor that is said of them; adequate : noise
    alone is left of all data.

    Whoever says that nothing happens has an NRMSE of 1, so that a model with a larger one fails,
    however large a floor it makes of what is open of the voltage.
    """
    if error is None or error >= 1.0:
        return Grade.FAILS
    if adequate:
        return Grade.EXPLAINS
    if error > max(ROUGH, CLOSE * floor):
        return Grade.FAILS
    return Grade.CLOSE if error <= CLOSE * floor else Grade.ROUGH


def _covariance(record: Record, fit: EventFit, told: Visibility) -> dict[str, Any]:
    """That of the record's numbers by all data."""
    if not record.covariance:
        return {}
    rows = [fit.misfit.parameter_prior.names.index(name) for name in record.covariance["names"]]
    return {
        **record.covariance,
        "matrix": told.covariance[np.ix_(rows, rows)].tolist(),
        "other_minima": [],
    }
