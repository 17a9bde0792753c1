"""evaluate(diagram, sweep) -> Record: check, assemble, fit, and say how well, how sure and how stable."""

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ibrid.assembly.interconnection import interconnect_rows
from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.symbolic import SymbolicModel, symbolic_model
from ibrid.errors import DiagramError, IbridError, OperatingPointError, near
from ibrid.evaluation.errors_by_part import error_parts, nrmse
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record, pade_orders
from ibrid.evaluation.reward import reward
from ibrid.evaluation.time_limit import time_limit
from ibrid.fit.identifiability import Visibility, visibility
from ibrid.fit.multistart import FitSettings, Solution, fit
from ibrid.fit.objective import OBJECTIVES
from ibrid.fit.problem import Problem
from ibrid.measurement.sweep import PointSweep, Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import NAMED_VOCABULARIES, Vocabulary, choose_vocabulary
from ibrid.structure.canonical import canonical_order, structure_hash
from ibrid.structure.check import violations, warnings
from ibrid.structure.diagram import Diagram
from ibrid.structure.parameters import EQUILIBRIA, ParameterTable, parameter_table
from ibrid.structure.program import program_text
from ibrid.structure.wiring import Wiring, split_port, wire

#: `shared`: one set of parameters fitted jointly over all operating points; `per-op`: a set for each, as in the paper.
PARAMETER_MODES = ("shared", "per-op")
#: Part of a box's width within which a value counts as at the bound.
AT_BOUND = 1e-6
#: A pole with a real part below this (rad/s) counts as stable; above zero only to forgive rounding.
STABLE_BELOW = 1e-6


def evaluate(
    diagram: Diagram,
    sweep: Sweep,
    *,
    parameters: str = "shared",
    equilibrium: str = "exact",
    vocabulary: str | Sequence[ModuleKind] = "extended",
    objective: str = "nrmse",
    restarts: int | None = None,
    seed: int = 0,
    holdout_op: str | Sequence[str] = (),
    settings: FitSettings | None = None,
    warm_start_below: float = 0.1,
) -> Record:
    """Fit a diagram's free parameters to measured admittances and record the result.

    Parameters
    ----------
    diagram : candidate structure. sweep : measured operating points.
    parameters : "shared" or "per-op". equilibrium : "exact" (computed) or "paper" (fitted numbers).
    vocabulary : "extended", "paper" or kinds of one's own. objective : see `ibrid.fit.objective`.
    restarts : further waves of starts at most. seed : of the random starts, mixed with structure and data.
    holdout_op : names of operating points kept out of the fit and predicted; needs shared parameters and "exact".
    settings : effort of the fit. warm_start_below : per-op, an error below this passes its parameters to the next point.

    Returns
    -------
    Record whose outcome is ok, invalid, failed or timeout. The same arguments give the same record, `seconds` apart.

    Raises
    ------
    IbridError : an option that does not exist, or an operating point that the sweep lacks.
    """
    started = time.perf_counter()
    plan = _plan(sweep, parameters, equilibrium, vocabulary, objective, restarts, seed, holdout_op, settings)
    text = program_text(diagram)
    base = Record(
        outcome=Outcome.INVALID, reward=reward(None), program=text, settings=plan.described(), vocabulary=plan.kinds
    )
    found = violations(diagram, plan.kinds, equilibrium=equilibrium)
    if found:
        return replace(base, reasons=tuple(map(str, found)), seconds=time.perf_counter() - started)
    try:
        with time_limit(plan.fit.seconds):
            record = _Evaluation(diagram, plan, base, warm_start_below).record()
    except DiagramError as error:
        record = replace(base, reasons=(str(error),))
    except TimeoutError as error:
        record = replace(base, outcome=Outcome.TIMEOUT, reasons=(f"the fit was {error}; raise the limit or simplify",))
    return replace(record, seconds=time.perf_counter() - started)


@dataclass(frozen=True)
class _Plan:
    """Checked options."""

    sweep: Sweep
    fitted: Sweep
    held_out: tuple[PointSweep, ...]
    parameters: str
    equilibrium: str
    vocabulary: str
    kinds: Vocabulary
    fit: FitSettings
    seed: int

    def described(self) -> dict[str, Any]:
        return {
            "parameters": self.parameters,
            "equilibrium": self.equilibrium,
            "vocabulary": self.vocabulary,
            "objective": self.fit.objective,
            "restarts": self.fit.restarts,
            "starts": self.fit.starts,
            "seeds": self.fit.seeds,
            "seed": self.seed,
            "seconds": self.fit.seconds,
            "solver": "ipopt",
            "data": self.sweep.source,
            "f0_hz": self.sweep.f0_hz,
            "power_node": self.sweep.power_node,
            "operating_points": {
                one.op.name: {"p": one.op.p, "q": one.op.q, "v": one.op.v} for one in self.sweep.points
            },
            "fitted_points": list(self.fitted.names),
            "frequency_hz": [
                min(float(one.frequency[0]) for one in self.sweep.points),
                max(float(one.frequency[-1]) for one in self.sweep.points),
            ],
        }


def _plan(
    sweep: Sweep,
    parameters: str,
    equilibrium: str,
    vocabulary: str | Sequence[ModuleKind],
    objective: str,
    restarts: int | None,
    seed: int,
    holdout_op: str | Sequence[str],
    settings: FitSettings | None,
) -> _Plan:
    for value, allowed, what in (
        (parameters, PARAMETER_MODES, "parameters"),
        (equilibrium, EQUILIBRIA, "equilibrium"),
        (objective, OBJECTIVES[:-1], "objective"),
    ):
        if value not in allowed:
            raise IbridError(f"{what} must be one of {', '.join(allowed)}, found {value!r}; {near(str(value), allowed)}")
    held = (holdout_op,) if isinstance(holdout_op, str) else tuple(holdout_op)
    for name in held:
        if name not in sweep.names:
            raise OperatingPointError(f"the data have no operating point {name!r} to hold out; {near(name, sweep.names)}")
    if held and (parameters != "shared" or equilibrium != "exact"):
        raise IbridError(
            "a held-out operating point can be predicted only with shared parameters and the exact equilibrium; "
            "drop --holdout-op or the other options"
        )
    if len(set(held)) >= len(sweep.points):
        raise IbridError("every operating point is held out; leave at least one to fit")
    fit_settings = settings or FitSettings()
    if restarts is not None:
        if restarts < 0:
            raise IbridError(f"restarts must be 0 or more, found {restarts}")
        fit_settings = replace(fit_settings, restarts=restarts)
    return _Plan(
        sweep=sweep,
        fitted=sweep.without(held) if held else sweep,
        held_out=tuple(sweep.point(name) for name in held),
        parameters=parameters,
        equilibrium=equilibrium,
        vocabulary=vocabulary if isinstance(vocabulary, str) else _vocabulary_name(vocabulary),
        kinds=choose_vocabulary(vocabulary),
        fit=replace(fit_settings, objective=objective),
        seed=seed,
    )


def _vocabulary_name(kinds: Sequence[ModuleKind]) -> str:
    known = {kind.name for kinds in NAMED_VOCABULARIES.values() for kind in kinds}
    extra = [kind.name for kind in kinds if kind.name not in known]
    return "extended" + "".join(f" + {name}" for name in extra)


class _Evaluation:
    def __init__(self, diagram: Diagram, plan: _Plan, base: Record, warm_start_below: float) -> None:
        self.diagram, self.plan, self.base, self.warm_start_below = diagram, plan, base, warm_start_below
        self.wiring = _canonical_wiring(diagram, plan)
        self.table = parameter_table(wire(diagram, plan.kinds), plan.equilibrium)
        self.omega_0 = 2 * np.pi * plan.sweep.f0_hz
        self.model: SymbolicModel = symbolic_model(
            self.wiring, equilibrium=plan.equilibrium, power_node=plan.sweep.power_node, omega_0=self.omega_0
        )

    def record(self) -> Record:
        plan = self.plan
        base = replace(
            self.base,
            warnings=tuple(map(str, warnings(self.diagram, plan.kinds, equilibrium=plan.equilibrium))),
            modules=len(self.diagram.instances),
            sums=sum(len(sources) > 1 for sources in self.wiring.sources.values()),
            residual_modules=sum(kind.residual for kind in self.wiring.kinds.values()),
            boxes={
                one.name: {"low": one.low, "high": one.high, "unit": one.unit, "meaning": one.meaning}
                for one in self.table.free
            },
        )
        problems = self._problems()
        base = replace(base, free_parameters=sum(problem.size for problem in problems))
        solutions = self._solve(problems)
        if solutions is None:
            return replace(base, outcome=Outcome.FAILED, reasons=(self._why_nothing_fits(),))
        return self._describe(base, problems, solutions)

    def _problems(self) -> list[Problem]:
        points = self.plan.fitted.points
        if self.plan.parameters == "shared":
            return [Problem(self.model, points)]
        return [Problem(self.model, (point,)) for point in points]

    def _solve(self, problems: list[Problem]) -> list[Solution] | None:
        solutions: list[Solution] = []
        warm = None
        for problem in problems:
            rng = np.random.default_rng(self._seed(problem))
            solution = fit(problem, self.wiring, rng, self.plan.fit, omega_0=self.omega_0, warm=warm)
            if solution is None:
                return None
            solutions.append(solution)
            warm = solution.x if solution.errors.mean() < self.warm_start_below else None
        return solutions

    def _seed(self, problem: Problem) -> list[int]:
        """From structure, data and the user's seed, so that a candidate's score repeats exactly."""
        digest = hashlib.sha256(
            structure_hash(self.diagram, self.plan.kinds, equilibrium=self.plan.equilibrium).encode()
        )
        for point in problem.points:
            digest.update(np.array([point.op.p, point.op.q, point.op.v]).tobytes())
            digest.update(np.ascontiguousarray(point.frequency).tobytes())
            digest.update(np.ascontiguousarray(point.admittance).tobytes())
        digest.update(str(self.plan.seed).encode())
        return [int.from_bytes(digest.digest()[i : i + 4], "big") for i in range(0, 16, 4)]

    def _why_nothing_fits(self) -> str:
        if self.plan.equilibrium == "exact":
            return (
                "no start has a real operating point with a finite response at the p, q, v of the data; "
                "check p, q, v and their per-unit base"
            )
        return "no start has a finite response at the measured frequencies; check the wiring"

    def _describe(self, base: Record, problems: list[Problem], solutions: list[Solution]) -> Record:
        plan = self.plan
        responses, values, numbers = [], {}, {}
        for problem, solution in zip(problems, solutions, strict=True):
            responses += problem.responses(solution.x)
            for index, point in enumerate(problem.points):
                values[point.op.name] = self._in_program_order(problem.values_at(solution.x, index))
                numbers[point.op.name] = (problem, solution, index)
        for point in plan.held_out:
            values[point.op.name] = dict(next(iter(values.values())))
        parts = error_parts(responses, plan.fitted.points)
        mean = float(np.mean(list(parts.by_op.values())))
        orders = pade_orders(self.wiring, self.table, list(values.values()), base.settings["frequency_hz"][1])
        poles = {point.op.name: self._poles(point, values[point.op.name], orders) for point in plan.sweep.points}
        lost = [name for name, found in poles.items() if found is None]
        settings = {**base.settings, "pade_orders": orders}
        if lost:
            return replace(
                base,
                outcome=Outcome.FAILED,
                settings=settings,
                reasons=(f"the best parameters have no real operating point at {', '.join(lost)}; check p, q and v",),
            )
        seen = [self._visibility(problem, solution) for problem, solution in zip(problems, solutions, strict=True)]
        intervals = self._intervals(numbers, seen, problems)
        for point in plan.held_out:
            intervals[point.op.name] = dict(next(iter(intervals.values())))
        return replace(
            base,
            outcome=Outcome.OK,
            nrmse=mean,
            reward=reward(mean),
            nrmse_by_op=parts.by_op,
            nrmse_by_band=parts.by_band,
            nrmse_by_entry=parts.by_entry,
            share_by_band=parts.share_by_band,
            nrmse_by_part=parts.table,
            holdout=self._holdout(values, base),
            order=len(np.atleast_1d(next(iter(poles.values())))),
            parameters=values,
            intervals=intervals,
            at_bound=self._at_bound(problems, solutions),
            stable={name: bool(np.real(found).max(initial=-np.inf) < STABLE_BELOW) for name, found in poles.items()},
            poles={name: _sorted_poles(found) for name, found in poles.items()},
            identifiability=self._sentences(problems, solutions, seen),
            twins=self._twins(problems, solutions),
            starts=self._starts(problems, solutions),
            covariance=self._covariance(problems, seen),
            settings=settings,
        )

    def _in_program_order(self, values: Mapping[str, float]) -> dict[str, float]:
        return {name: values[name] for name in self.table.names}

    def _poles(self, point: PointSweep, values: Mapping[str, float], orders: Mapping[str, int]) -> np.ndarray | None:
        matrices = module_matrices(
            self.wiring,
            self.table,
            values,
            (point.op.p, point.op.q, point.op.v),
            equilibrium=self.plan.equilibrium,
            power_node=self.plan.sweep.power_node,
            omega_0=self.omega_0,
            pade_orders=orders,
        )
        joined = interconnect_rows(self.wiring, matrices, exact_delays=False)
        a = np.zeros((joined.size, joined.size))
        for i, row in enumerate(joined.rows[: joined.size]):
            for j, value in row.items():
                if j < joined.size:
                    a[i, j] = value
        return np.linalg.eigvals(a) if np.isfinite(a).all() else None

    def _holdout(self, values: Mapping[str, Mapping[str, float]], base: Record) -> dict[str, float]:
        if not self.plan.held_out:
            return {}
        problem = Problem(self.model, self.plan.held_out)
        found = next(iter(values.values()))
        x = problem.coordinates.to_x(np.array([found[one.name] for one in problem.numbers]))
        return {
            point.op.name: nrmse(response, point)
            for response, point in zip(problem.responses(x), self.plan.held_out, strict=True)
        }

    def _labels(self, problem: Problem) -> list[str]:
        return [
            one.name if one.point is None or len(problem.points) == 1 else f"{one.name} at {problem.points[one.point].op.name}"
            for one in problem.numbers
        ]

    def _visibility(self, problem: Problem, solution: Solution) -> Visibility:
        return visibility(problem, solution.x, self._labels(problem))

    def _intervals(self, numbers, seen: list[Visibility], problems: list[Problem]) -> dict[str, dict[str, Any]]:
        intervals: dict[str, dict[str, Any]] = {}
        for op, (problem, _, index) in numbers.items():
            answer = seen[problems.index(problem)]
            labels = self._labels(problem)
            found = {
                one.name: answer.intervals.get(labels[problem.index[index, local]])
                for local, one in enumerate(self.model.parameters)
            }
            intervals[op] = {name: found[name] for name in self.table.names}
        return intervals

    def _at_bound(self, problems: list[Problem], solutions: list[Solution]) -> tuple[str, ...]:
        touched: list[str] = []
        for problem, solution in zip(problems, solutions, strict=True):
            low, high = problem.coordinates.x_low, problem.coordinates.x_high
            near_edge = np.minimum(solution.x - low, high - solution.x) <= AT_BOUND * (high - low)
            where = "" if len(problems) == 1 else f" at {problem.points[0].op.name}"
            touched += [label + where for label, edge in zip(self._labels(problem), near_edge, strict=True) if edge]
        return tuple(touched)

    def _sentences(
        self, problems: list[Problem], solutions: list[Solution], seen: list[Visibility]
    ) -> tuple[str, ...]:
        sentences: list[str] = []
        for problem, solution, answer in zip(problems, solutions, seen, strict=True):
            where = "" if len(problems) == 1 else f"at {problem.points[0].op.name}: "
            sentences += [where + sentence for sentence in answer.sentences]
            for twin in solution.twins:
                changed = _changes(problem, solution.x, twin)
                sentences.append(f"{where}a twin fits as well: {changed}; the one with the smaller R_F is reported")
            sentences.append(
                f"{where}{solution.agreeing} of {len(solution.finished)} finished starts agree with the best, "
                f"in {solution.waves} waves; intervals assume {answer.noise}"
            )
        return tuple(sentences)

    def _twins(self, problems: list[Problem], solutions: list[Solution]) -> tuple[dict[str, float], ...]:
        return tuple(
            self._in_program_order(problem.values_at(twin, 0))
            for problem, solution in zip(problems, solutions, strict=True)
            for twin in solution.twins
        )

    def _starts(self, problems: list[Problem], solutions: list[Solution]) -> dict[str, Any]:
        return {
            "finished": sum(len(solution.finished) for solution in solutions),
            "agreeing": sum(solution.agreeing for solution in solutions),
            "waves": sum(solution.waves for solution in solutions),
            "evaluations": sum(solution.evaluations for solution in solutions),
            "ipopt": [solution.ipopt_status for solution in solutions],
        }

    def _covariance(self, problems: list[Problem], seen: list[Visibility]) -> dict[str, Any]:
        if len(problems) != 1:
            return {}
        return {"of": "search coordinates (logarithms of positive parameters)", "names": self._labels(problems[0]),
                "matrix": seen[0].covariance}  # fmt: skip


def _canonical_wiring(diagram: Diagram, plan: _Plan) -> Wiring:
    """The wiring in an order that depends on the structure alone, so that renaming does not change a score."""
    wiring = wire(diagram, plan.kinds)
    rank = {
        name: index for index, name in enumerate(canonical_order(diagram, plan.kinds, equilibrium=plan.equilibrium))
    }
    instances = tuple(sorted(wiring.instances, key=lambda one: rank[one.name]))

    def place(port: str) -> tuple[int, str]:
        name, inner = split_port(port)
        return rank.get(name, -1), inner

    return Wiring(
        instances,
        {one.name: wiring.kinds[one.name] for one in instances},
        {target: tuple(sorted(wiring.sources[target], key=place)) for target in sorted(wiring.sources, key=place)},
    )


def _sorted_poles(poles: np.ndarray | None) -> list[list[float]]:
    found = np.zeros(0) if poles is None else poles
    ordered = sorted(found, key=lambda one: (abs(one), one.real, one.imag))
    return [[float(one.real), float(one.imag)] for one in ordered]


def _changes(problem: Problem, x: np.ndarray, twin: np.ndarray) -> str:
    here, there = problem.coordinates.to_theta(x), problem.coordinates.to_theta(twin)
    moved = [
        f"{one.name} {after:.4g} instead of {before:.4g}"
        for one, before, after in zip(problem.numbers, here, there, strict=True)
        if abs(after - before) > 1e-3 * abs(before)
    ]
    return ", ".join(moved[:6]) + (" and more" if len(moved) > 6 else "")
