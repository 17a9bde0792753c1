"""The evaluation record of a model that was fitted to recordings.

With a sweep it describes that, as other records do; without one, the model's own linear response.
"""

from collections.abc import Mapping, Sequence
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

#: Frequencies, Hz, at which a model fitted to recordings alone is described: so densely that no
#: vector fit is needed to tell its noise.
CURVE_FREQUENCIES = np.geomspace(1.0, 2500.0, 52)
#: Singular values below this part of the largest count as zero: of finite-difference derivatives.
ZERO_SINGULAR_VALUE = 1e-6


def assess_identifiability(fit: EventFit) -> Visibility:
    """Assess which parameters recordings, sweep and prior together determine."""
    misfit = fit.misfit
    return visible_by(
        fit.jacobian,
        fit.x,
        misfit.coordinates,
        misfit.parameter_prior.names,
        misfit.noise.source,
        tolerance=ZERO_SINGULAR_VALUE,
    )


def simulate_events(model: Model, data: EventDataset, events: Events) -> Playback:
    """Simulate the response of a model to every record."""
    limits = data.limits_of(model)
    return play(EventModel(model.diagram, model.refit.values, limits, data.kinds), events)


def mean_nrmse(playback: Playback, held: Sequence[str]) -> float | None:
    """Return the mean NRMSE of the records that are not held out.

    None where a simulation diverged.
    """
    responses = [response for response in playback.records if response.record.name not in held]
    errors = [response.nrmse for response in responses if response.nrmse is not None]
    return float(np.mean(errors)) if errors and len(errors) == len(responses) else None


def noise_nrmse(noise: EventNoise) -> float:
    """Return the NRMSE that noise and sampling alone would leave, the mean over the records."""
    return float(np.mean([*noise.floors.values()]))


def linear_model_sweep(model: Model, data: EventDataset, events: Events) -> Sweep:
    """Return the admittance of a model, linearised at the steady state of each record."""
    placeholder = np.broadcast_to(np.eye(2, dtype=complex), (len(CURVE_FREQUENCIES), 2, 2))
    points = [
        OperatingPoint(record.name, record.rest.p, record.rest.q, record.rest.v)
        for record in events.records
    ]
    sweep = Sweep(
        tuple(PointSweep(op, CURVE_FREQUENCIES, placeholder) for op in points),
        f0_hz=events.f0_hz,
        power_node="pcc",
        source=events.source,
    )
    record = record_at(model.diagram, sweep, model.refit.values, vocabulary=data.kinds)
    point_sweeps = [
        PointSweep(op, CURVE_FREQUENCIES, record.response(op.name, CURVE_FREQUENCIES))
        for op in points
    ]
    return replace(sweep, points=tuple(point_sweeps))


def build_record(
    model: Model, data: EventDataset, problem: EventProblem, playback: Playback
) -> Record:
    """Build the record of a fitted model, with errors and intervals of all data together.

    playback : the simulated response to every record.
    """
    record = _linear_record(model, data, problem)
    visibility = assess_identifiability(model.refit)
    errors = {
        response.record.name: response.nrmse
        for response in playback.records
        if response.nrmse is not None
    }
    held_errors = {name: errors[name] for name in problem.held if name in errors}
    intervals = {
        op: {name: visibility.intervals[name] for name in known}
        for op, known in record.intervals.items()
    }
    record = replace(
        record,
        settings={**record.settings, **_event_settings(model, data, problem, visibility)},
        nrmse_by_record=errors,
        nrmse_by_window=playback.by_window,
        holdout={**record.holdout, **held_errors},
        intervals=intervals,
        covariance=_covariance(record, model.refit, visibility),
        identifiability=visibility.sentences,
    )
    error = mean_nrmse(playback, problem.held)
    floor = noise_nrmse(data.noise)
    grade = grade_recordings(error, floor, adequate=model.is_adequate())
    if problem.study is not None:
        worse = max(grade, Grade(record.grade or grade), key=list(Grade).index)
        return replace(record, grade=str(worse))
    record = _replace_sweep_errors(record, model, data, floor)
    fitted_errors = {name: value for name, value in errors.items() if name not in problem.held}
    return replace(record, nrmse=error, nrmse_by_op=fitted_errors, grade=str(grade))


def _linear_record(model: Model, data: EventDataset, problem: EventProblem) -> Record:
    """Return the record of the linear model, of the sweep or of its own admittance."""
    values = model.refit.values
    if problem.study is not None:
        return record_at(model.diagram, problem.study, values)
    sweep = linear_model_sweep(model, data, problem.events)
    return record_at(model.diagram, sweep, values, vocabulary=data.kinds)


def _event_settings(
    model: Model, data: EventDataset, problem: EventProblem, visibility: Visibility
) -> dict[str, Any]:
    """Return what the settings of the record say of the recordings: limits, source, solver."""
    variance = np.diag(visibility.covariance).clip(0.0, 1.0)
    names = model.refit.misfit.parameter_prior.names
    deviation_by_name = dict(zip(names, np.sqrt(variance).tolist(), strict=True))
    limits = []
    for limit in data.limits_of(model):
        full_names = {name: f"{limit.id}.{name}" for name in limit.parameters}
        values = {name: model.refit.values[full] for name, full in full_names.items()}
        deviations = {name: deviation_by_name.get(full, 0.0) for name, full in full_names.items()}
        limits.append({**limit.plain(), "parameters": values, "deviations": deviations})
    settings: dict[str, Any] = {"large_signal": limits, "events": problem.events.source}
    if problem.events.solver:
        settings["events_solver"] = problem.events.solver
    return settings


def _replace_sweep_errors(record: Record, model: Model, data: EventDataset, floor: float) -> Record:
    """Replace the errors of a sweep, where there is none, by those of the recordings."""
    names = ("nrmse_by_band", "nrmse_by_entry", "share_by_band", "nrmse_by_part")
    empty: dict[str, Any] = {name: {} for name in names}
    is_stated = all(event.sigma is not None for event in data.noise.events.records)
    source = "sigma" if is_stated else "repeats"  # steady-state samples repeat one value
    misfit = {
        "chi2_per_dof": model.refit.chi2 / model.refit.dof,
        "floor": {"value": floor, "from": source},
        "by_entry_band": [],
    }
    over_noise = float(np.sqrt(model.refit.chi2 / model.refit.misfit.count))
    return replace(record, noise_floor=floor, misfit=misfit, over_noise=over_noise, **empty)


def grade_recordings(error: float | None, floor: float, *, adequate: bool) -> Grade:
    """Grade a mean NRMSE of recordings beside the noise floor.

    A model without any response has an NRMSE of 1, so that one with a larger error fails, however
    large a floor it implies by the unknown voltage between samples.

    adequate : noise alone is left of all data.
    """
    if error is None or error >= 1.0:
        return Grade.FAILS
    if adequate:
        return Grade.EXPLAINS
    if error > max(ROUGH, CLOSE * floor):
        return Grade.FAILS
    return Grade.CLOSE if error <= CLOSE * floor else Grade.ROUGH


def _covariance(record: Record, fit: EventFit, visibility: Visibility) -> Mapping[str, Any]:
    """Return the covariance of the record's parameters by all data."""
    if not record.covariance:
        return {}
    names = fit.misfit.parameter_prior.names
    rows = [names.index(name) for name in record.covariance["names"]]
    matrix = visibility.covariance[np.ix_(rows, rows)].tolist()
    return {**record.covariance, "matrix": matrix, "other_minima": []}
