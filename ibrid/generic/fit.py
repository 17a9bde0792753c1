"""A generic model fitted to recordings: flags tried one after another, thresholds scanned,
constants by bounded least squares; what the recordings do not show stays at its value.

Law: the sum of squares of independent errors in standard deviations. A constant is shown where its
standard deviation, from the Jacobian at the end, is below a quarter of its range; of those that are
not, that with the largest goes back to its value and the rest is fitted again. Covariance: (J^T
J)^-1, times the squares a degree of freedom where these exceed one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from ibrid.generic.block import Constant
from ibrid.generic.dialect import DIALECTS, Dialect
from ibrid.generic.model import GenericModel
from ibrid.generic.seen import SeenRecord

#: Of constants, by name.
Values = Mapping[str, float]
#: Part of a range by which a constant is moved for a derivative; part of it that a standard
#: deviation may be of one that is shown; change of the squares that is none.
MOVED, SHOWN, NOTHING = 1e-3, 0.25, 1e-6
#: Evaluations of the fit for each flag and of the last; values of a scanned threshold.
SHORT, LONG, SCANNED = 6, 40, 7
#: Part of the largest curvature of the squares below which a direction is not seen; part of a range
#: from its end within which a value ended at its bound.
BLIND, AT_BOUND = 1e-14, 2e-3
#: Change of the squares beyond which a value is no longer as likely; correlation that is told.
LIKELY, CORRELATED = 4.0, 0.95


@dataclass(frozen=True, eq=False)
class GenericFit:
    """`values` : all, by name. `deviations` : name -> standard deviation of what was fitted.
    `scanned` : threshold -> values that are as likely. `unseen` : name -> why it was left.
    `correlations` : pairs above `CORRELATED`. `flags_alike` : flags whose other choice is as
    likely. `squares` : a sample. `at_bound` : what ended at the bound of its range, which has no
    interval.
    """

    values: Values
    deviations: Values
    scanned: Mapping[str, tuple[float, float]]
    unseen: Mapping[str, str]
    correlations: tuple[tuple[str, str, float], ...]
    flags_alike: tuple[str, ...]
    squares: float
    at_bound: tuple[str, ...] = ()


class _Problem:
    """Residuals of all records, of values by name."""

    def __init__(
        self, model: GenericModel, records: Sequence[SeenRecord], dialect: Dialect
    ) -> None:
        self.model, self.records, self.dialect = model, records, dialect

    def residual(self, values: Values) -> np.ndarray:
        """(N,) of all records."""

        def play(time, v, told, rest):
            return self.model.play(values, self.dialect, time, v, told, rest)

        return np.concatenate([seen.residual(seen.current(play)) for seen in self.records])

    def squares(self, values: Values) -> float:
        """Their sum."""
        return float(np.sum(self.residual(values) ** 2))

    def jacobian(self, values: Values, free: Sequence[Constant]) -> np.ndarray:
        """(N, K) of the constants, each in parts of its range."""
        columns, here = [], self.residual(values)
        for constant in free:
            moved = MOVED * (constant.high - constant.low)
            step = moved if values[constant.name] + moved <= constant.high else -moved
            side = self.residual({**values, constant.name: values[constant.name] + step})
            columns.append((side - here) * (constant.high - constant.low) / step)
        return np.stack(columns, axis=1)

    def fitted(self, values: Values, free: Sequence[Constant], most: int) -> Values:
        """The values with `free` where the squares are least, of at most so many evaluations."""
        if not free:
            return dict(values)
        low = np.array([constant.low for constant in free])
        span = np.array([constant.high for constant in free]) - low

        def at(x: np.ndarray) -> Values:
            return {
                **values,
                **{
                    constant.name: float(value)
                    for constant, value in zip(free, low + span * x, strict=True)
                },
            }

        begin = np.array([values[constant.name] for constant in free])
        solution = least_squares(
            lambda x: self.residual(at(x)),
            np.clip((begin - low) / span, 1e-3, 1.0 - 1e-3),
            jac=lambda x: self.jacobian(at(x), free),  # type: ignore[arg-type]
            bounds=(0.0, 1.0),
            max_nfev=most,
        )
        return at(solution.x)


def fit_generic(
    model: GenericModel,
    records: Sequence[SeenRecord],
    start: Values | None = None,
    dialect: Dialect = DIALECTS["wecc"],
    held_flags: bool = False,
) -> GenericFit:
    """Fit. start : values to begin at, and of what is not shown; typical ones without.
    held_flags : whether its flags are those of the start.
    """
    problem, begin = _Problem(model, records, dialect), {**model.typical, **(start or {})}
    best = begin if held_flags else _flags_chosen(problem, begin)
    for other in model.starts:
        best = _better(problem, best, {**begin, **other}, held_flags)
    best = problem.fitted(best, _shown(problem, best), LONG)
    best, scanned, unseen = _scan(problem, best)
    best, free, dropped = _only_shown(problem, best, begin)
    return _answer(problem, best, free, scanned, unseen | dropped)


def _flags_chosen(problem: _Problem, begin: Values) -> Values:
    """The values with the loops whose fit leaves least, then with each other flag at the choice
    whose fit leaves less.
    """
    flags = [flag for block in problem.model.blocks for flag in block.flags if flag.tried]
    loops = [flag for flag in flags if flag.loop]
    answers: dict[bytes, Values] = {}
    for chosen in product(*(flag.choices for flag in loops)):
        named = zip((flag.name for flag in loops), map(float, chosen), strict=True)
        values = {**begin, **dict(named)}
        answers.setdefault(np.round(problem.residual(values), 6).tobytes(), values)
    ended = [problem.fitted(values, _shown(problem, values), SHORT) for values in answers.values()]
    best = min(ended, key=problem.squares)
    for flag in (one for one in flags if not one.loop):
        other = {**best, flag.name: 1.0 - best[flag.name]}
        least = problem.squares(best)
        if abs(problem.squares(other) - least) < NOTHING * (1.0 + least):
            continue
        tried = problem.fitted(other, _shown(problem, other), SHORT)
        if problem.squares(tried) < least - LIKELY:
            best = tried
    return best


def _better(problem: _Problem, best: Values, start: Values, held_flags: bool) -> Values:
    """The values, or those that a short fit reaches from another start, where they leave less."""
    chosen = start if held_flags else _flags_chosen(problem, start)
    tried = problem.fitted(chosen, _shown(problem, chosen), SHORT)
    return tried if problem.squares(tried) < problem.squares(best) - LIKELY else best


def _shown(problem: _Problem, values: Values) -> list[Constant]:
    """Constants that change the answer at all."""
    fitted = [constant for constant in problem.model.constants if constant.way == "fitted"]
    size = np.linalg.norm(problem.jacobian(values, fitted), axis=0)
    return [constant for constant, norm in zip(fitted, size, strict=True) if norm > 1.0]


def _scan(
    problem: _Problem, values: Values
) -> tuple[Values, dict[str, tuple[float, float]], dict[str, str]]:
    """The values with each threshold at the nearest of those that are as likely as the best,
    between which values that is, and why those are left that change nothing.
    """
    scanned, unseen = {}, {}
    for constant in (one for one in problem.model.constants if one.way == "scanned"):
        grid = np.unique(
            np.append(np.linspace(constant.low, constant.high, SCANNED), values[constant.name])
        )
        squares = np.array([problem.squares({**values, constant.name: at}) for at in grid])
        likely = grid[squares <= squares.min() + LIKELY]
        if np.ptp(squares) < NOTHING * (1.0 + squares.min()):
            unseen[constant.name] = "no event reaches it"
            continue
        if not np.isin(values[constant.name], likely):
            nearest = likely[int(np.argmin(np.abs(likely - values[constant.name])))]
            values = {**values, constant.name: float(nearest)}
        scanned[constant.name] = float(likely.min()), float(likely.max())
    return values, scanned, unseen


def _only_shown(
    problem: _Problem, values: Values, begin: Values
) -> tuple[Values, list[Constant], dict[str, str]]:
    """The values with what is not shown back at the start; what is left free; why each was left."""
    fitted = [constant for constant in problem.model.constants if constant.way == "fitted"]
    free, unseen = _shown(problem, values), {}
    for constant in fitted:
        if constant in free:
            continue
        back = {**values, constant.name: begin[constant.name]}
        if problem.squares(back) <= problem.squares(values) + LIKELY:
            unseen[constant.name] = "it changes nothing in these events"
            values = back
        else:
            unseen[constant.name] = f"these events refute {begin[constant.name]:g}, and no more"
    while free:
        deviations = np.sqrt(np.diag(_covariance(problem, values, free)))
        worst = int(np.argmax(deviations))
        if deviations[worst] <= SHOWN:
            break
        constant = free.pop(worst)
        unseen[constant.name] = "these events do not tell it from the others"
        values = {**values, constant.name: begin[constant.name]}
        values = problem.fitted(values, free, LONG)
    return problem.fitted(values, free, LONG), free, unseen


def _covariance(problem: _Problem, values: Values, free: Sequence[Constant]) -> np.ndarray:
    """(K, K), in parts of the ranges."""
    jacobian = problem.jacobian(values, free)
    freedom = max(len(jacobian) - len(free), 1)
    inflated = max(problem.squares(values) / freedom, 1.0)
    sizes, directions = np.linalg.eigh(jacobian.T @ jacobian)
    least = BLIND * max(float(sizes[-1]), 1.0)  # a direction that nothing sees stays unknown
    return inflated * (directions / np.maximum(sizes, least)) @ directions.T


def _answer(
    problem: _Problem,
    values: Values,
    free: Sequence[Constant],
    scanned: Mapping[str, tuple[float, float]],
    unseen: Mapping[str, str],
) -> GenericFit:
    span = np.array([constant.high - constant.low for constant in free])
    covariance = _covariance(problem, values, free) if free else np.zeros((0, 0))
    deviations = np.sqrt(np.diag(covariance))
    scale = np.outer(deviations, deviations)
    related = np.divide(covariance, scale, out=np.zeros_like(covariance), where=scale > 0)
    pairs = tuple(
        (free[a].name, free[b].name, float(related[a, b]))
        for a in range(len(free))
        for b in range(a)
        if abs(related[a, b]) > CORRELATED
    )
    residual = problem.residual(values)
    least = float(residual @ residual)
    flags = [flag for block in problem.model.blocks for flag in block.flags if flag.tried]
    alike = tuple(
        flag.name
        for flag in flags
        if problem.squares({**values, flag.name: 1.0 - values[flag.name]}) <= least + LIKELY
    )
    at_bound = [
        constant.name
        for constant in free
        if min(values[constant.name] - constant.low, constant.high - values[constant.name])
        < AT_BOUND * (constant.high - constant.low)
    ]
    own_deviations = zip((one.name for one in free), (deviations * span).tolist(), strict=True)
    return GenericFit(
        values=values,
        deviations={name: value for name, value in own_deviations if name not in at_bound},
        at_bound=tuple(at_bound),
        scanned=dict(scanned),
        unseen=dict(unseen),
        correlations=pairs,
        flags_alike=alike,
        squares=least / max(len(residual) - len(free), 1),
    )
