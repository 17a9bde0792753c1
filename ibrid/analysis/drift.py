"""Whether new data are of the device that a record describes, and what changed since: nothing, parameters, structure, labels.

The record knows its parameters as x = x_0 + B z, z standard normal (its covariance and its boxes). Of the new data, whitened by
their noise,

    T(A) = min over z, d of |r(x_0 + B z + E_A d)|^2 + |z|^2

is what is left when the parameters in A have changed freely. T() - T({j}) is chi2 with one degree of freedom where nothing
changed; parameters enter one by one, the best first, while they lower T beyond what P of them would by chance in a part
`FALSE_ALARM` of cases (likelihood ratio, Bonferroni), a pair where neither of it does alone; those without which the rest does as
well leave again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.stats import chi2

from ibrid.analysis.parametric import ParametricModel, uncertainty
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.noise import noise_of
from ibrid.gap.result import Gap
from ibrid.gap.workflow import find_gap
from ibrid.measurement.sweep import OperatingPoint, PointSweep, Sweep

#: Probability that an unchanged device is said to have changed, and the p-value below which a model does not fit the data.
FALSE_ALARM, ADEQUATE = 0.01, 1e-3
#: Most parameters that change together, and candidates of a pair.
MOST, PAIRED = 3, 8
#: Steps of a fit, its relative end, and the difference of T within which another parameter explains the change as well.
STEPS, END, ALIKE = 25, 1e-6, 6.0
#: What a gap says, whose tolerances are wide, of data that the record's own values do not answer.
_VERDICTS = {"no-gap": "parameters", "parameters-only": "parameters", "data-convention": "labels"}


@dataclass(frozen=True)
class Change:
    """A parameter that changed, by as much as `after` differs from the record's `before`.

    `interval` : 95 %, of `after`. `z` : signed root of the likelihood ratio; None from the gap. `alike` : others whose change
    would explain the data as well.
    """

    parameter: str
    before: float
    after: float
    interval: tuple[float, float] | None
    z: float | None
    alike: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        interval = None if self.interval is None else list(self.interval)
        return {**vars(self), "interval": interval, "alike": list(self.alike)}


@dataclass(frozen=True)
class Drift:
    """`verdict` : same, parameters, structure or labels. `p_value` : of the model with the changes. `gap` : asked where they do
    not suffice."""

    verdict: str
    sentence: str
    changed: tuple[Change, ...]
    p_value: float
    noise: str
    gap: Gap | None = None

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "schema": "ibrid.drift/1",
            "verdict": self.verdict,
            "sentence": self.sentence,
            "changed": [one.plain() for one in self.changed],
            "p_value": self.p_value,
            "noise": self.noise,
            "false_alarm": FALSE_ALARM,
            "effects": [one.id for one in self.gap.effects] if self.gap else [],
        }


def drift(record: Record, sweep: Sweep) -> Drift:
    """What changed between the data of a record and a new sweep, at the same operating points or others.

    Raises IbridError where the record has no covariance, another nominal frequency, or a model without an answer there.
    """
    if (record.settings.get("parameters"), record.settings.get("equilibrium")) != ("shared", "exact"):
        raise IbridError("drift needs one set of values: fit the record with --parameters shared --equilibrium exact")
    if abs(float(record.settings["f0_hz"]) - sweep.f0_hz) > 1e-6:
        raise IbridError(
            f"the record is of {record.settings['f0_hz']:g} Hz, the data of {sweep.f0_hz:g} Hz; take data of one"
        )
    found = _Fits(record, sweep)
    added, fit = _changed(found)
    p_value = float(chi2.sf(fit.cost, found.numbers))
    if p_value <= ADEQUATE or len(added) >= MOST:
        gap = find_gap(record, sweep, progress="silent")
        verdict = _VERDICTS.get(gap.verdict, "structure")
        changed = _moved(gap) if verdict == "parameters" else ()
        return Drift(verdict, gap.sentence, changed, p_value, found.source, gap)
    changed = tuple(found.change(k, added, fit) for k in range(len(added)))
    return Drift("parameters" if changed else "same", _sentence(changed, found), changed, p_value, found.source)


def _changed(found: "_Fits") -> tuple[list[int], "_Fit"]:
    """Places of the parameters that changed, in the order in which they entered, and the fit with them."""
    added: list[int] = []
    last = found.fit(())
    level = float(chi2.isf(FALSE_ALARM / max(found.size, 1), 1))
    while len(added) < min(MOST, found.size):
        tried = {j: found.fit((*added, j), last) for j in range(found.size) if j not in added}
        least = min(one.cost for one in tried.values())
        alike = [j for j, one in tried.items() if one.cost < least + ALIKE]
        best = min(alike, key=lambda j: abs(tried[j].w[-1]))
        if last.cost - least > level:
            added, last = [*added, best], tried[best]
            continue
        if added or chi2.sf(last.cost, found.numbers) > ADEQUATE:
            break
        few = sorted(tried, key=lambda j: tried[j].cost)[:PAIRED]
        pairs = {pair: found.fit(pair, last) for pair in combinations(few, 2)}
        pair = min(pairs, key=lambda one: pairs[one].cost, default=())
        if not pair or last.cost - pairs[pair].cost <= chi2.isf(FALSE_ALARM / len(pairs), 2):
            break
        added, last = list(pair), pairs[pair]
    for j in tuple(added[:-1]):
        rest = [one for one in added if one != j]
        without = found.fit(rest)
        if without.cost - last.cost < level:
            added, last = rest, without
    return added, last


@dataclass(frozen=True)
class _Fit:
    """`x` (P,), `w` the coordinates (z, d), `cost` T, `curvature` J'J + prior of w."""

    w: np.ndarray
    x: np.ndarray
    cost: float
    curvature: np.ndarray


class _Fits:
    """Fits of a record's model to new data, each with some parameters free and the others as the record knows them."""

    def __init__(self, record: Record, sweep: Sweep) -> None:
        settings = {**record.settings, "power_node": sweep.power_node}
        model = ParametricModel(replace(record, settings=settings), _any_point(record))
        sure = uncertainty(record, ParametricModel(record, _any_point(record)))
        if sure is None:
            raise IbridError("the record holds no covariance; fit again with --parameters shared")
        noise = noise_of(sweep)
        self.source = noise.source
        self.names, self.size, self.x0 = model.names, len(model.names), model.x
        self.coordinates = model.coordinates
        self.root = sure.directions
        self._set(model, noise.sweep.points)
        if not noise.known:  # its level is that of what the freest model leaves
            everything = self.fit(tuple(range(self.size)))
            scale = np.sqrt(everything.cost / max(self.numbers - self.size, 1))
            self._set(model, noise.times(float(scale)).sweep.points)

    def _set(self, model: ParametricModel, points: Sequence[PointSweep]) -> None:
        self.problem = model.problem(points)
        self.measured = np.concatenate([_flat(one.admittance[..., None])[:, 0] for one in points])
        self.sigma = np.concatenate([np.tile(np.asarray(one.sigma).ravel(), 2) for one in points])
        self.numbers = len(self.measured)

    def fit(self, free: Sequence[int], near: _Fit | None = None) -> _Fit:
        """The least T with these parameters free, by damped least squares from the record's values, from these with the last
        parameter a quarter up or down, and from another fit with one parameter less."""
        starts = np.zeros((3 if free else 1, self.root.shape[1] + len(free)))
        if free:
            starts[1:, -1] = np.log(1.25), -np.log(1.25)
        if near is not None and len(near.w) < starts.shape[1]:
            starts = np.vstack([starts, np.pad(near.w, (0, starts.shape[1] - len(near.w)))])
        return min((self._from(w, free) for w in starts), key=lambda one: one.cost)

    def _from(self, w: np.ndarray, free: Sequence[int]) -> _Fit:
        directions = np.hstack([self.root, np.eye(self.size)[:, list(free)]])
        pulled = np.concatenate([np.ones(self.root.shape[1]), np.zeros(len(free))])
        residual, damping = self._residual(self._x(directions, w)), 1e-3
        if not np.isfinite(residual).all():
            raise IbridError("the record's model has no finite answer at the operating points of the data")
        cost = float(residual @ residual + pulled @ w**2)
        curvature = np.diag(pulled)
        for _ in range(STEPS):
            slopes = self._slopes(self._x(directions, w)) @ directions
            curvature = slopes.T @ slopes + np.diag(pulled)
            gradient = slopes.T @ residual + pulled * w
            before = cost
            for _ in range(8):
                step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature) + 1e-12), gradient)
                there = self._residual(self._x(directions, w - step))
                new = float(there @ there + pulled @ (w - step) ** 2)
                if new < cost:
                    w, residual, cost, damping = w - step, there, new, damping / 5
                    break
                damping *= 5
            if before - cost <= END * max(cost, 1.0):
                break
        return _Fit(w, self._x(directions, w), cost, curvature)

    def change(self, k: int, added: Sequence[int], last: _Fit) -> Change:
        """The parameter that entered k-th, in the fit with all."""
        j = added[k]
        place = self.root.shape[1] + k
        deviation = float(np.sqrt(max(np.linalg.pinv(last.curvature)[place, place], 0.0)))
        moved = [last.w[place] + side * 1.96 * deviation for side in (0.0, -1.0, 1.0)]
        ends = [self.x0 + one * np.eye(self.size)[j] for one in (0.0, *moved)]
        before, after, low, high = (float(self.coordinates.to_theta(x)[j]) for x in ends)
        others = tuple(one for one in added if one != j)
        ratio = max(self.fit(others).cost - last.cost, 0.0)
        alike = [
            self.names[other]
            for other in range(self.size)
            if other not in added and self.fit((*others, other)).cost < last.cost + ALIKE
        ]
        z = float(np.copysign(np.sqrt(ratio), after - before))
        return Change(self.names[j], before, after, (min(low, high), max(low, high)), z, tuple(alike))

    def _x(self, directions: np.ndarray, w: np.ndarray) -> np.ndarray:
        return np.clip(self.x0 + directions @ w, self.coordinates.x_low, self.coordinates.x_high)

    def _residual(self, x: np.ndarray) -> np.ndarray:
        answer = np.concatenate([_flat(one[..., None])[:, 0] for one in self.problem.responses(x)])
        return np.nan_to_num((answer - self.measured) / self.sigma, nan=1e12, posinf=1e12, neginf=-1e12)

    def _slopes(self, x: np.ndarray) -> np.ndarray:
        return np.concatenate([_flat(one) for one in self.problem.jacobians(x)]) / self.sigma[:, None]


def _flat(values: np.ndarray) -> np.ndarray:
    """(K, 2, 2, P) complex as (8 K, P): real parts, then imaginary ones."""
    rows = values.reshape(-1, values.shape[-1])
    return np.concatenate([np.real(rows), np.imag(rows)])


def _any_point(record: Record) -> OperatingPoint:
    name = next(iter(record.parameters), None)
    if name is None:
        raise IbridError("the record has no fitted values; make it with ibrid evaluate")
    numbers = record.settings["operating_points"][name]
    return OperatingPoint(name, *(float(numbers[key]) for key in "pqv"))


def _moved(gap: Gap) -> tuple[Change, ...]:
    """What the gap's refit moved beyond its tolerance, in place of a test of single parameters."""
    return tuple(
        Change(
            one.name,
            one.nominal,
            one.refitted,
            None if one.low is None or one.high is None else (one.low, one.high),
            None,
        )
        for one in gap.moved
        if abs(one.sigmas) > 1
    )


def _sentence(changed: Sequence[Change], found: _Fits) -> str:
    if not changed:
        return (
            f"The same within the noise ({found.source}): no parameter changed "
            f"(an unchanged device is called changed in {100 * FALSE_ALARM:g} % of cases)."
        )
    words = []
    for one in changed:
        factor = f", {one.after / one.before:.3g} times as much" if one.before else ""
        interval = "" if one.interval is None else f" ({one.interval[0]:.4g} to {one.interval[1]:.4g})"
        alike = f", or {' or '.join(one.alike)}, which the data cannot tell from it" if one.alike else ""
        words.append(f"{one.parameter} went from {one.before:.4g} to {one.after:.4g}{interval}{factor}{alike}")
    return f"{'; '.join(words)}; nothing else changed."
