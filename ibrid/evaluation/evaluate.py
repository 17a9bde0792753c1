"""evaluate(diagram, sweep) -> Record: check, assemble, fit, and say how well, how sure and how
stable.
"""

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Unpack

import numpy as np

from ibrid.assembly.symbolic import symbolic_model
from ibrid.border import takes_kinds
from ibrid.errors import DiagramError, IbridError
from ibrid.evaluation.describe import BestFit, describe, unfitted
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.reading import read_otherwise
from ibrid.evaluation.record import Record
from ibrid.fit import kernel
from ibrid.fit.multistart import Solution, fit
from ibrid.fit.problem import Problem
from ibrid.fit.settings import FitSettings
from ibrid.fit.starts import StartDrawer
from ibrid.fit.twins import find_twins
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.structure.compiling.compiled import CompiledDiagram
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.network.outside import NOTHING
from ibrid.study import Study, StudyOptions

#: Per-op, a mean error below this passes its parameters to the next operating point.
WARM_START_BELOW = 0.1


@takes_kinds
@hearing_interrupts()
def evaluate(
    diagram: Diagram,
    sweep: Sweep | Study,
    *,
    objective: str | None = None,
    restarts: int | None = None,
    settings: FitSettings | None = None,
    warm_start_below: float = WARM_START_BELOW,
    warm: Mapping[str, Mapping[str, float]] | None = None,
    **options: Unpack[StudyOptions],
) -> Record:
    """Fit a diagram's free parameters to measured admittances and record the result.

    Parameters
    ----------
    diagram : candidate structure. sweep : measured operating points, or a study of them.
    parameters, equilibrium, vocabulary, holdout_op, seed, port, labels : as of `ibrid.study.Study`;
    the seed is of the
        random starts, mixed with structure and data. Where uncertain labels are found wrong, the
        record is of the data put right, and its `labels` say what was wrong.
    objective : see `ibrid.fit.objective`; None: that of `settings`, else sigma where the
        noise of all fitted points is known and nrmse where it is not.
    restarts : further waves of starts at most.
    settings : effort of the fit. warm_start_below : per-op, an error below this passes its
    parameters to the next point.
    warm : operating point -> name -> value, such as `parameters` of another record: tried beside
    the starts.

    Returns
    -------
    Record whose outcome is ok, invalid or failed. The same arguments give the same record,
    `seconds` apart; so do diagrams that differ in names and order of lines alone.

    Raises
    ------
    IbridError : an option that does not exist, or an operating point that the sweep lacks.
    """
    kernel.load()
    started = time.perf_counter()
    study = Study.of(sweep, **options)
    if study.events is not None:
        raise IbridError(
            "a study of records alone has no admittances; fit its records by evaluate_events"
        )
    compiled = study.compiled(diagram)
    effort = study.effort(settings, objective=objective, restarts=restarts)
    record = _record_of(compiled, study, effort, warm_start_below, warm or {})
    if study.labels != "exact":
        record = read_otherwise(record, compiled, study, effort, _evaluate_from)
    return replace(record, seconds=time.perf_counter() - started)


def _evaluate_from(
    compiled: CompiledDiagram, study: Study, effort: FitSettings, before: Record
) -> Record:
    """Fit from the values of another record; the diagram is behind its port already."""
    study = replace(study, port=NOTHING)
    return _record_of(compiled, study, study.effort(effort), WARM_START_BELOW, before.parameters)


def _record_of(
    compiled: CompiledDiagram,
    study: Study,
    effort: FitSettings,
    warm_start_below: float,
    warm: Mapping[str, Mapping[str, float]],
) -> Record:
    """Check the diagram, fit it where it is legal, and describe the fit."""
    base = unfitted(compiled.diagram, study, effort)
    omega_0, fitted = study.sweep.omega_0, list[BestFit]()
    before: list[Mapping[str, float]] = []  # the answer at the previous operating point
    try:
        violations, warnings = compiled.violations, compiled.warnings
        base = replace(
            base, reasons=tuple(map(str, violations)), warnings=tuple(map(str, warnings))
        )
        if violations:
            return base
        structure, wiring = compiled.structure_hash, compiled.canonical_wiring
        model = symbolic_model(wiring, **study.physics)
        for group in study.groups:
            problem = Problem(model, group)
            drawer, twins = (
                StartDrawer(problem, wiring, omega_0),
                find_twins(problem, wiring, omega_0),
            )
            rng = np.random.default_rng(_seed(structure, problem.points, study.seed))
            known = [warm[point.op.name] for point in group if point.op.name in warm]
            known = known if len(known) == len(group) else before
            solution = fit(problem, drawer, twins, rng, effort, warm=known)
            if solution is None:
                return replace(base, outcome=Outcome.FAILED, reasons=(_why_nothing_fits(study),))
            fitted.append(BestFit(problem, solution))
            before = (
                [problem.values_at(solution.x, 0)]
                if solution.errors.mean() < warm_start_below
                else []
            )
        held_out = Problem(model, study.held_out) if study.held_out else None
        return describe(compiled, wiring, study, effort.minimised, base, fitted, held_out)
    except DiagramError as error:
        return replace(base, reasons=(str(error),))


def _seed(structure_hash: str, points: Sequence[PointSweep], seed: int) -> list[int]:
    """From structure, data and the user's seed, so that a candidate's score repeats exactly."""
    digest = hashlib.sha256(structure_hash.encode())
    for point in points:
        digest.update(np.array(point.op.pqv).tobytes())
        digest.update(point.frequency.tobytes() + point.admittance.tobytes())
    digest.update(str(seed).encode())
    return [int.from_bytes(digest.digest()[i : i + 4], "big") for i in range(0, 16, 4)]


def _why_nothing_fits(study: Study) -> str:
    if study.port:
        return (
            "no start has a real operating point behind the port: it cannot carry the p, q of the "
            "data at their v; check the "
            "port's elements with their units and tolerances, its power_node, and p, q, v"
        )
    if study.equilibrium == "exact":
        return (
            "no start has a real operating point with a finite response at the p, q, v of the "
            "data; "
            "check p, q, v and their per-unit base"
        )
    return "no start has a finite response at the measured frequencies; check the wiring"


def record_at(
    diagram: Diagram,
    sweep: Sweep | Study,
    values: Mapping[str, float],
    **options: Unpack[StudyOptions],
) -> Record:
    """Describe a diagram at values of its free parameters, shared by all operating points,
    equilibria computed.

    sweep : a study, or the data of one with `options`. values : free name -> value, clipped to its
    box. Intervals are those of an estimator that weighs the data by their noise where the sweep has
    a sigma. The outcome is `invalid` for an illegal diagram.
    """
    study = Study.of(sweep, **options)
    compiled = study.compiled(diagram)
    effort = study.effort()
    violations, warnings = compiled.violations, compiled.warnings
    base = unfitted(compiled.diagram, study, effort)
    base = replace(base, reasons=tuple(map(str, violations)), warnings=tuple(map(str, warnings)))
    if violations:
        return base
    wiring = compiled.wiring
    model = symbolic_model(wiring, **study.physics)
    problem = Problem(model, study.fitted.points)
    held_out = Problem(model, study.held_out) if study.held_out else None
    x = problem.coordinates.to_x(np.array([values[one.name] for one in problem.numbers]))
    x = np.clip(x, problem.coordinates.x_low, problem.coordinates.x_high)
    solution = Solution(x=x, errors=np.sqrt(problem.costs(x[None], effort.minimised)[0]))
    described = describe(
        compiled, wiring, study, effort.minimised, base, [BestFit(problem, solution)], held_out
    )
    return replace(described, reasons=())
