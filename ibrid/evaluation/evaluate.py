"""evaluate(diagram, sweep) -> Record: check, assemble, fit, and say how well, how sure and how stable."""

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ibrid.assembly.symbolic import symbolic_model
from ibrid.errors import DiagramError, IbridError
from ibrid.evaluation.describe import Fitted, describe
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.plan import Plan, make_plan
from ibrid.evaluation.record import Record
from ibrid.evaluation.reward import reward
from ibrid.evaluation.time_limit import time_limit
from ibrid.fit import kernel
from ibrid.fit.multistart import fit
from ibrid.fit.problem import Problem
from ibrid.fit.settings import FitSettings
from ibrid.measurement.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.structure.canonical import canonical_wiring, structure_hash
from ibrid.structure.check import examine
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import program_text


def evaluate(
    diagram: Diagram,
    sweep: Sweep,
    *,
    parameters: str = "shared",
    equilibrium: str = "exact",
    vocabulary: str | Sequence[ModuleKind] = "extended",
    objective: str | None = None,
    restarts: int | None = None,
    seed: int = 0,
    holdout_op: str | Sequence[str] = (),
    settings: FitSettings | None = None,
    warm_start_below: float = 0.1,
    warm: Mapping[str, Mapping[str, float]] | None = None,
) -> Record:
    """Fit a diagram's free parameters to measured admittances and record the result.

    Parameters
    ----------
    diagram : candidate structure. sweep : measured operating points.
    parameters : "shared" or "per-op". equilibrium : "exact" (computed) or "paper" (fitted numbers).
    vocabulary : "extended", "paper" or kinds of one's own.
    objective : see `ibrid.fit.objective`; None: that of `settings`, else sigma where the
        noise of all fitted points is known and nrmse where it is not.
    restarts : further waves of starts at most. seed : of the random starts, mixed with structure and data.
    holdout_op : names of operating points kept out of the fit and predicted; needs shared parameters and "exact".
    settings : effort of the fit. warm_start_below : per-op, an error below this passes its parameters to the next point.
    warm : operating point -> name -> value, such as `parameters` of another record: tried beside the starts.

    Returns
    -------
    Record whose outcome is ok, invalid, failed or timeout. The same arguments give the same record, `seconds` apart;
    so do diagrams that differ in names and order of lines alone.

    Raises
    ------
    IbridError : an option that does not exist, or an operating point that the sweep lacks.
    """
    kernel.load()
    started = time.perf_counter()
    if not isinstance(diagram, Diagram) or not isinstance(sweep, Sweep):
        raise IbridError(
            f"evaluate takes a Diagram and a Sweep, found {type(diagram).__name__} and {type(sweep).__name__}; "
            "make them with parse_program or textbook, and read_sweep"
        )
    plan = make_plan(sweep, parameters, equilibrium, vocabulary, objective, restarts, seed, holdout_op, settings)
    base = Record(
        outcome=Outcome.INVALID,
        reward=reward(None),
        modules=len(diagram.instances),
        program=program_text(diagram),
        settings=plan.described(),
        vocabulary=plan.kinds,
    )
    try:
        with time_limit(plan.fit.seconds):
            found, habits = examine(diagram, plan.kinds, equilibrium=equilibrium)
            base = replace(base, reasons=tuple(map(str, found)), warnings=tuple(map(str, habits)))
            record = base if found else _evaluate(diagram, plan, base, warm_start_below, warm or {})
    except DiagramError as error:
        record = replace(base, reasons=(str(error),))
    except TimeoutError as error:
        record = replace(base, outcome=Outcome.TIMEOUT, reasons=(f"the fit was {error}; raise the limit or simplify",))
    return replace(record, seconds=time.perf_counter() - started)


def _evaluate(
    diagram: Diagram, plan: Plan, base: Record, warm_start_below: float, warm: Mapping[str, Mapping[str, float]]
) -> Record:
    wiring = canonical_wiring(diagram, plan.kinds, equilibrium=plan.equilibrium)
    omega_0 = plan.sweep.omega_0
    model = symbolic_model(wiring, equilibrium=plan.equilibrium, power_node=plan.sweep.power_node, omega_0=omega_0)
    points = plan.fitted.points
    groups = [points] if plan.parameters == "shared" else [(point,) for point in points]
    effort = replace(plan.fit, seconds=plan.fit.seconds / len(groups))
    fitted: list[Fitted] = []
    before: list[Mapping[str, float]] = []  # the answer at the previous operating point
    for group in groups:
        problem = Problem(model, group)
        rng = np.random.default_rng(_seed(diagram, plan, problem))
        known = [warm[point.op.name] for point in group if point.op.name in warm]
        known = known if len(known) == len(group) else before
        solution = fit(problem, wiring, rng, effort, omega_0=omega_0, warm=known)
        if solution is None:
            return replace(base, outcome=Outcome.FAILED, reasons=(_why_nothing_fits(plan),))
        fitted.append(Fitted(problem, solution))
        before = [problem.values_at(solution.x, 0)] if solution.errors.mean() < warm_start_below else []
    return describe(diagram, wiring, plan, base, fitted)


def _seed(diagram: Diagram, plan: Plan, problem: Problem) -> list[int]:
    """From structure, data and the user's seed, so that a candidate's score repeats exactly."""
    digest = hashlib.sha256(structure_hash(diagram, plan.kinds, equilibrium=plan.equilibrium).encode())
    for point in problem.points:
        digest.update(np.array([point.op.p, point.op.q, point.op.v]).tobytes())
        digest.update(point.frequency.tobytes() + point.admittance.tobytes())
    digest.update(str(plan.seed).encode())
    return [int.from_bytes(digest.digest()[i : i + 4], "big") for i in range(0, 16, 4)]


def _why_nothing_fits(plan: Plan) -> str:
    if plan.equilibrium == "exact":
        return (
            "no start has a real operating point with a finite response at the p, q, v of the data; "
            "check p, q, v and their per-unit base"
        )
    return "no start has a finite response at the measured frequencies; check the wiring"
