"""From a fit to its record: errors, parameters with intervals, poles, and what the data cannot see,
in words.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ibrid.assembly.interconnection import interconnect_rows
from ibrid.assembly.modules_at import module_matrices
from ibrid.errors import DiagramError
from ibrid.evaluation.errors_by_part import error_parts, noise_floor, nrmse
from ibrid.evaluation.grade import grade_of, misfit_of
from ibrid.evaluation.outcome import Outcome, reward
from ibrid.evaluation.record import Record
from ibrid.fit.identifiability import Minimum, Visibility, noise_of, other_minima, visibility
from ibrid.fit.multistart import Solution
from ibrid.fit.problem import Problem
from ibrid.fit.settings import FitSettings
from ibrid.measurement.sweeps.sweep import PointSweep, measured_numbers
from ibrid.modules.delay import pade_limit, pade_order
from ibrid.structure.compiling.compiled import CompiledDiagram
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text
from ibrid.structure.reading.parameters import ParameterTable, parameters_at
from ibrid.structure.reading.wiring import Wiring
from ibrid.study import Study
from ibrid.writing import PlainData

#: A pole with a real part below this (rad/s) counts as stable; above zero only to forgive rounding.
STABLE_BELOW = 1e-6
#: NRMSE from which on the conventions of the data are questioned too.
SUSPICIOUS_ERROR = 0.1


@dataclass(frozen=True)
class BestFit:
    """A problem and its solution: all operating points when parameters are shared, one when they
    are not.
    """

    problem: Problem
    solution: Solution

    @property
    def labels(self) -> list[str]:
        """Names of the free numbers, with the operating point of those that belong to one of
        several.
        """
        points = self.problem.points
        return [
            one.name
            if one.point is None or len(points) == 1
            else f"{one.name} at {points[one.point].op.name}"
            for one in self.problem.numbers
        ]

    @property
    def names(self) -> list[str]:
        """Names of its operating points."""
        return [point.op.name for point in self.problem.points]


def unfitted(diagram: Diagram, study: Study, effort: FitSettings) -> Record:
    """The record of a diagram before anything is known of it."""
    return Record(
        outcome=Outcome.INVALID,
        reward=reward(None),
        modules=len(diagram.instances),
        program=program_text(diagram),
        settings={
            **_settings(study, effort),
            **({"outside": diagram.outside.to_json()} if diagram.outside else {}),
        },
        vocabulary=study.kinds,
    )


def _settings(study: Study, fit: FitSettings) -> PlainData:
    """How a record was made, as its JSON says: `fit` is the effort, from `Study.effort`."""
    points, sweep = study.sweep.points, study.sweep
    known = sweep.s_base_va is not None and sweep.v_base_v is not None
    bases = {"bases": {"s_base_va": sweep.s_base_va, "v_base_v": sweep.v_base_v}} if known else {}
    return {
        "parameters": study.parameters,
        "equilibrium": study.equilibrium,
        "vocabulary": study.vocabulary_name,
        "objective": fit.minimised,
        "restarts": fit.restarts,
        "starts": fit.starts,
        "seed": study.seed,
        **({} if study.labels == "exact" else {"labels": study.labels}),
        "effort": fit.effort,
        "solver": "ipopt",
        "data": study.sweep.source,
        "f0_hz": study.sweep.f0_hz,
        "power_node": study.sweep.power_node,
        **bases,
        "operating_points": {
            point.op.name: {"p": point.op.p, "q": point.op.q, "v": point.op.v} for point in points
        },
        "fitted_points": list(study.fitted.names),
        "frequency_hz": [
            min(float(point.frequency[0]) for point in points),
            max(float(point.frequency[-1]) for point in points),
        ],
    }


def describe(
    compiled: CompiledDiagram,
    wiring: Wiring,
    study: Study,
    objective: str,
    base: Record,
    fitted: Sequence[BestFit],
    held_out: Problem | None = None,
) -> Record:
    """Write the record of fits that together cover all fitted operating points and minimised the
    `objective`.

    wiring : that of `compiled` in the order in which it was fitted, the canonical one or the
    program's.
    held_out : the fitted model at the held-out operating points, where there are any.
    """
    return _Description(
        compiled.parameter_table, wiring, study, objective, fitted, held_out
    ).record(base)


class _Description:
    def __init__(
        self,
        table: ParameterTable,
        wiring: Wiring,
        study: Study,
        objective: str,
        fitted: Sequence[BestFit],
        held_out: Problem | None,
    ) -> None:
        self.wiring, self.study, self.fitted, self.held_out = wiring, study, fitted, held_out
        self.table, self.names = table, [one.name for one in table.free]  # in the program's order
        self.seen = [
            visibility(one.problem, one.solution.x, one.labels, objective) for one in fitted
        ]
        self.others = [
            other_minima(
                one.problem,
                one.solution.x,
                one.solution.finished,
                noise_of(one.problem, one.solution.x)[0],
            )
            for one in fitted
        ]
        self.values = {
            name: self._ordered(one.problem.values_at(one.solution.x, index))
            for one in fitted
            for index, name in enumerate(one.names)
        }
        for point in study.held_out:
            self.values[point.op.name] = dict(next(iter(self.values.values())))
        self.numbers = {
            name: parameters_at(wiring, table, values) for name, values in self.values.items()
        }
        self.delays = {  # the longest of each module that delays, over the operating points
            name: max(numbers[name][kind.delay] for numbers in self.numbers.values())
            for name, kind in wiring.kinds.items()
            if kind.delay is not None
        }

    def record(self, base: Record) -> Record:
        study = self.study
        responses = [
            response for one in self.fitted for response in one.problem.responses(one.solution.x)
        ]
        parts = error_parts(responses, study.fitted.points)
        mean = float(np.mean(list(parts.by_op.values())))
        misfit = misfit_of(
            responses, study.fitted.points, sum(one.problem.size for one in self.fitted)
        )
        try:
            orders, poles = self._realisation(base.settings["frequency_hz"][1])
        except DiagramError as error:  # the fit stands, but its matrices do not
            return replace(base, outcome=Outcome.FAILED, reasons=(str(error),))
        base = replace(
            base,
            sums=sum(len(sources) > 1 for sources in self.wiring.sources.values()),
            residual_modules=sum(kind.residual for kind in self.wiring.kinds.values()),
            free_parameters=sum(one.problem.size for one in self.fitted),
            boxes={
                one.name: {
                    "low": one.low,
                    "high": one.high,
                    "unit": one.unit,
                    "meaning": one.meaning,
                }
                for one in self.table.free
            },
            settings={**base.settings, "pade_orders": orders},
            warnings=base.warnings + self._pade_warnings(orders, base.settings["frequency_hz"][1]),
        )
        lost = [
            name for name, found in poles.items() if found.size and not np.isfinite(found).all()
        ]
        if lost:
            reason = (
                f"the best parameters have no real operating point at {', '.join(lost)}; check p, "
                "q and v"
            )
            return replace(base, outcome=Outcome.FAILED, reasons=(reason,))
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
            holdout=self._holdout(),
            order=max(len(found) for found in poles.values()),
            parameters=self.values,
            intervals=self._intervals(),
            at_bound=self._at_bound(),
            stable={
                name: bool(np.real(found).max(initial=-np.inf) < STABLE_BELOW)
                for name, found in poles.items()
            },
            poles={name: _sorted_poles(found) for name, found in poles.items()},
            identifiability=self._sentences(),
            twins=tuple(
                self._ordered(one.problem.values_at(twin, 0))
                for one in self.fitted
                for twin in one.solution.twins
            ),
            warnings=base.warnings
            + self._count_warnings()
            + self._solver_warnings()
            + self._data_warnings(mean),
            starts=self._starts(),
            covariance=self._covariance(),
            noise_floor=noise_floor(study.fitted.points),
            grade=str(grade_of(mean, misfit)),
            misfit=misfit,
            over_noise=_over_noise(responses, study.fitted.points),
        )

    def _ordered(self, values: Mapping[str, float]) -> dict[str, float]:
        return {name: values[name] for name in self.names}

    def _realisation(self, highest: float) -> tuple[dict[str, int], dict[str, np.ndarray]]:
        """Orders of the Pade forms, and the poles at every operating point.

        The direct term of a Pade form is 1 or -1 by its order; where that closes a loop of gain 1,
        the next order does not.
        """
        orders = {name: pade_order(delay, highest) for name, delay in self.delays.items()}
        try:
            return orders, self._poles(orders)
        except DiagramError:
            orders = {name: order + 1 for name, order in orders.items()}
            return orders, self._poles(orders)

    def _pade_warnings(self, orders: Mapping[str, int], highest: float) -> tuple[str, ...]:
        warnings = []
        for name, order in orders.items():
            if (limit := pade_limit(self.delays[name], order)) < highest:
                warnings.append(
                    f"{name}: its Pade form of order {order} is within 1 degree of the delay up to "
                    f"{limit:.0f} Hz only; "
                    "matrices, poles and exports hold to there, frequency responses are exact"
                )
        return tuple(warnings)

    def _poles(self, orders: Mapping[str, int]) -> dict[str, np.ndarray]:
        """Poles of every operating point with Pade forms of the delays."""
        points = self.study.sweep.points
        return {point.op.name: self._poles_at(point, orders) for point in points}

    def _poles_at(self, point: PointSweep, orders: Mapping[str, int]) -> np.ndarray:
        """The same of one; not a number where there is no operating point."""
        numbers, physics = self.numbers[point.op.name], self.study.physics
        matrices = module_matrices(
            self.wiring, numbers, point.op.pqv, pade_orders=orders, **physics
        )
        joined = interconnect_rows(self.wiring, matrices, exact_delays=False)
        a = joined.matrices()[0]
        return np.linalg.eigvals(a) if np.isfinite(a).all() else np.full(joined.size, np.nan)

    def _holdout(self) -> dict[str, float]:
        problem = self.held_out
        if problem is None:
            return {}
        found = next(iter(self.values.values()))
        x = problem.coordinates.to_x(np.array([found[one.name] for one in problem.numbers]))
        return {
            point.op.name: nrmse(response, point)
            for response, point in zip(problem.responses(x), problem.points, strict=True)
        }

    def _intervals(self) -> dict[str, dict[str, Any]]:
        intervals: dict[str, dict[str, Any]] = {}
        for fit, answer in zip(self.fitted, self.seen, strict=True):
            for index, name in enumerate(fit.names):
                bounds = {
                    parameter.name: answer.intervals.get(
                        fit.labels[fit.problem.index[index, local]]
                    )
                    for local, parameter in enumerate(fit.problem.parameters)
                }
                intervals[name] = {parameter: bounds[parameter] for parameter in self.names}
        for point in self.study.held_out:
            intervals[point.op.name] = dict(next(iter(intervals.values())))
        return intervals

    def _at_bound(self) -> tuple[str, ...]:
        touched: list[str] = []
        for fit in self.fitted:
            near_edge = fit.problem.at_bound(fit.solution.x)
            where = "" if len(self.fitted) == 1 else f" at {fit.names[0]}"
            touched += [
                label + where for label, edge in zip(fit.labels, near_edge, strict=True) if edge
            ]
        return tuple(touched)

    def _sentences(self) -> tuple[str, ...]:
        sentences: list[str] = []
        for fit, answer, others in zip(self.fitted, self.seen, self.others, strict=True):
            where = "" if len(self.fitted) == 1 else f"at {fit.names[0]}: "
            sentences += [where + sentence for sentence in answer.sentences]
            sentences += [where + _twin_sentence(fit, twin) for twin in fit.solution.twins]
            sentences += [where + _others_sentence(fit, answer, others)] if others else []
            if fit.solution.waves:
                sentences.append(where + _support_sentence(fit.solution, answer))
        return tuple(sentences)

    def _count_warnings(self) -> tuple[str, ...]:
        """Where as many numbers are free as were measured, so that a good fit says nothing."""
        counts = [(one.problem.size, measured_numbers(one.problem.points)) for one in self.fitted]
        return tuple(
            f"{free} free numbers were fitted to {measured} measured ones at "
            f"{', '.join(one.names)}: a good fit says nothing "
            "then; measure at more frequencies or operating points"
            for one, (free, measured) in zip(self.fitted, counts, strict=True)
            if free >= measured
        )

    def _solver_warnings(self) -> tuple[str, ...]:
        """Where Ipopt ended without saying that it had converged."""
        return tuple(
            f"Ipopt ended with {one.solution.ipopt_status} at {', '.join(one.names)}: the optimum "
            "may be slightly better"
            for one in self.fitted
            if not one.solution.ipopt_status.startswith(("Solve", "Search_Direction", "nothing"))
        )

    def _data_warnings(self, error: float) -> tuple[str, ...]:
        """What a first look at the data says, when the fit is so bad that the data may be to
        blame.
        """
        if error < SUSPICIOUS_ERROR:
            return ()
        return tuple(f"of the data: {sentence}" for sentence in self.study.doubts)

    def _starts(self) -> PlainData:
        solutions = [one.solution for one in self.fitted]
        return {
            "independent": sum(one.independent for one in solutions),
            "agreeing": sum(one.agreeing for one in solutions),
            "waves": sum(one.waves for one in solutions),
            "evaluations": sum(one.evaluations for one in solutions),
            "ipopt": [one.ipopt_status for one in solutions],
        }

    def _covariance(self) -> PlainData:
        if len(self.fitted) != 1:
            return {}
        return {
            "of": "search coordinates (logarithms of positive parameters)",
            "names": self.fitted[0].labels,
            "matrix": self.seen[0].covariance.tolist(),
            "other_minima": [
                {"chi2_above": other.above, "x": other.x.tolist()} for other in self.others[0]
            ],
        }


def _over_noise(responses: Sequence[np.ndarray], points: Sequence[PointSweep]) -> float | None:
    """Root mean square over all real and imaginary parts of the residual over sigma."""
    squares = [
        np.abs((response - point.admittance) / point.sigma) ** 2 / 2.0
        for response, point in zip(responses, points, strict=True)
        if point.sigma is not None
    ]
    return float(np.sqrt(np.mean(np.concatenate(squares)))) if len(squares) == len(points) else None


def _sorted_poles(poles: np.ndarray) -> list[list[float]]:
    ordered = sorted(poles, key=lambda one: (abs(one), one.real, one.imag))
    return [[float(one.real), float(one.imag)] for one in ordered]


def _twin_sentence(fit: BestFit, twin: np.ndarray) -> str:
    here = fit.problem.coordinates.to_theta(fit.solution.x)
    there = fit.problem.coordinates.to_theta(twin)
    moved = [
        f"{label} {after:.4g} instead of {before:.4g}"
        for label, before, after in zip(fit.labels, here, there, strict=True)
        if abs(after - before) > 1e-3 * abs(before)
    ]
    return f"a twin fits as well: {', '.join(moved)}; the more usual one is reported"


def _others_sentence(fit: BestFit, answer: Visibility, others: Sequence[Minimum]) -> str:
    """Other minima within the noise, and what has another value at the likeliest of them."""
    coordinates = fit.problem.coordinates
    here, there = coordinates.to_theta(fit.solution.x), coordinates.to_theta(others[0].x)
    outside = [
        f"{label} {after:.3g} instead of {before:.3g}"
        for label, before, after in zip(fit.labels, here, there, strict=True)
        if (interval := answer.intervals.get(label)) and not interval[0] <= after <= interval[1]
    ]
    number = "1 other minimum" if len(others) == 1 else f"{len(others)} other minima"
    more = f", {len(outside) - 3} more" if len(outside) > 3 else ""
    return (
        f"the noise does not exclude {number} (chi2 higher by {others[0].above:.1f}"
        + (f" to {others[-1].above:.1f}" if len(others) > 1 else "")
        + ")"
        + (f", at the likeliest {', '.join(outside[:3])}{more}" if outside else "")
        + "; intervals are those of the reported one, bands of predictions include all"
    )


def _support_sentence(solution: Solution, answer: Visibility) -> str:
    waves = "1 wave" if solution.waves == 1 else f"{solution.waves} waves"
    return (
        f"{solution.agreeing} of {solution.independent} independent starts that were carried to "
        f"their end, in {waves}, "
        f"agree with the best answer; intervals assume {answer.noise}"
    )
