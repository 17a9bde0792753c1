"""What the data can and cannot see: intervals of the parameters and the directions along which
nothing changes.

The Jacobian of the whitened residual in logarithms of the parameters is decomposed; singular values
at rounding level are null directions, and the covariance is that of the rest: of the estimator that
minimises the fit's own objective, which need not weigh the data by their noise (J+ Sigma J+', the
"sandwich" of weighted least squares).

A fit with a weakly seen inner loop has other minima that the noise does not exclude: the best of
one draw of noise need not be that of the next, and what the covariance of one minimum says is then
too narrow. A minimum whose chi2 lies D above that of the best has the relative likelihood exp(-D /
2). Answers of the model are spread about that of the best by the second moment of the mixture, sum
over minima of exp(-D / 2) (y_k - y)^2, beside the linear spread. Starts that end at equal
responses, twins among them, are one minimum.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.fit.anchor import frobenius, right_singular_vectors
from ibrid.fit.multistart import LocalMinimum
from ibrid.fit.problem import Coordinates, Problem
from ibrid.measurement.sweeps.sweep import measured_numbers

#: Singular values below this part of the largest are taken as zero.
RANK_TOLERANCE = 1e-9
#: Smallest relative error that is believed of any model (linearisation and rounding).
MODEL_FLOOR = 1e-9
#: Standard deviations of sqrt(chi2 / dof) beyond which a fit leaves more than its sigma.
BEYOND_CHANCE = 4.0
#: Two-sided 95 % of a normal distribution.
QUANTILE = 1.959963984540054
#: A 95 % interval wider than this factor, both ways, is called barely visible.
BARELY_VISIBLE = 10.0


@dataclass(frozen=True)
class Visibility:
    """Answer of `visibility`.

    `noise` : where the assumed noise comes from, in words. `intervals` : free number -> (low,
    high), 95 %, or None when a null direction moves it. `null_directions` : relative changes per
    free number that leave every response unchanged.
    `covariance` : (P, P) of x, without the null directions.
    """

    noise: str
    intervals: dict[str, tuple[float, float] | None]
    null_directions: tuple[dict[str, float], ...]
    covariance: np.ndarray
    sentences: tuple[str, ...]


def visibility(
    problem: Problem, x: np.ndarray, labels: list[str], objective: str | None = None
) -> Visibility:
    """Intervals and null directions at an optimum x (P,); `labels` (P,) name the free numbers in
    the sentences.

    objective : that x minimises; None, as sigma: one that weighs the data by their noise.
    """
    size = problem.size
    deviations, source = noise_of(problem, x)
    nothing = Visibility(source, {}, (), np.zeros((size, size)), ())
    if not size:
        return nothing
    held = np.diag(np.sqrt(problem.hold))[problem.hold > 0]
    jacobian = np.concatenate([problem.white_slopes(x, deviations), held])
    if not np.isfinite(jacobian).all():
        return nothing
    factor = (
        None
        if objective in (None, "sigma")
        else _weight_times_noise(problem, x, deviations, objective)
    )
    return visible_by(jacobian, x, problem.coordinates, labels, source, factor=factor)


def visible_by(
    jacobian: np.ndarray,
    x: np.ndarray,
    coordinates: Coordinates,
    labels: Sequence[str],
    source: str,
    *,
    factor: np.ndarray | None = None,
    tolerance: float = RANK_TOLERANCE,
) -> Visibility:
    """The same of whitened slopes (R, P) of any data at x (P,), finite.

    factor : (R,) weight of each number in the fit times its deviation; None where data are weighed
    by their noise. tolerance : singular values below this part of the largest are taken as zero.
    """
    size = len(x)
    scale = np.linalg.norm(jacobian, axis=0)
    largest = scale.max() or 1.0
    unit = np.where(
        scale <= tolerance * largest, largest, scale
    )  # so that a blind column stays small
    values, right = right_singular_vectors(jacobian / unit)
    null = values <= tolerance * values[0]
    root = right[~null].T / values[~null]
    if factor is not None:
        white = (jacobian / unit) @ root  # orthonormal columns
        factor = np.concatenate([factor, np.ones(len(jacobian) - len(factor))])
        q, r = np.linalg.qr(factor[:, None] * white)
        root = root @ (np.linalg.pinv(r) @ q.T * factor)
    root = root / unit[:, None]
    covariance = root @ root.T
    directions = (right[null] / unit).T  # columns in x
    moved = np.zeros(size, dtype=bool)
    if directions.size:
        moved = np.abs(directions / np.abs(directions).max(axis=0)).max(axis=1) > 1e-4
    theta = coordinates.to_theta(x)
    relative = coordinates.slope(theta) / np.where(theta == 0, 1.0, theta)
    intervals: dict[str, tuple[float, float] | None] = {}
    wide = []
    for index, label in enumerate(labels):
        deviation = float(np.sqrt(covariance[index, index]))
        if moved[index]:
            intervals[label] = None
            continue
        ends = coordinates.to_theta(
            np.stack([x, x])
            + np.outer([-1.0, 1.0], np.eye(size)[index] * min(QUANTILE * deviation, 50.0))
        )[:, index]
        intervals[label] = (float(ends.min()), float(ends.max()))
        if QUANTILE * deviation * abs(float(relative[index])) > np.log(BARELY_VISIBLE):
            wide.append(label)
    named = tuple(_named(direction * relative, labels) for direction in _sparse_basis(directions).T)
    sentences = [_sentence(direction) for direction in named]
    if wide:
        sentences.append(
            f"{_listed(wide)}: the data barely see "
            f"{'it' if len(wide) == 1 else 'them'}; the 95 % interval "
            f"spans more than a factor {BARELY_VISIBLE:g} each way"
        )
    return Visibility(source, intervals, named, covariance, tuple(sentences))


def noise_of(problem: Problem, x: np.ndarray) -> tuple[list[np.ndarray], str]:
    """Standard deviation of each real number, and where it comes from: sigma where that is known,
    else the same part of |Y|.

    Where a fit leaves more than its sigma by far, all are multiplied by sqrt(chi2 / dof), as is
    done for measurements that contradict each other (Birge, Phys. Rev. 40, 1932; Particle Data
    Group, Review, 5.2.2).
    """
    known = all(point.sigma is not None for point in problem.points)
    deviations = [
        np.hypot(np.asarray(point.sigma), MODEL_FLOOR * frobenius(point))
        if known
        else np.broadcast_to(frobenius(point), point.admittance.shape)
        for point in problem.points
    ]
    pairs = zip(problem.responses(x), problem.points, deviations, strict=True)
    chi2 = sum(
        float((np.abs((response - one.admittance) / spread) ** 2).sum())
        for response, one, spread in pairs
    )
    dof = max(measured_numbers(problem.points) - problem.size, 1)
    level = float(np.sqrt(chi2 / dof))
    if not known:
        level = max(level, MODEL_FLOOR)
        source = f"the misfit itself ({level:.1e} of |Y| in each real number)"
    elif level > 1.0 + BEYOND_CHANCE / np.sqrt(2.0 * dof):
        source = (
            f"the sigma of the data times {level:.3g}, which the fit leaves, and that the diagram "
            "is right"
        )
    else:
        return deviations, "the sigma of the data"
    return [level * spread for spread in deviations], source


def _weight_times_noise(
    problem: Problem, x: np.ndarray, deviations: list[np.ndarray], objective: str
) -> np.ndarray:
    """Weight of each real number in the fit times its standard deviation, in the order of the
    Jacobian's rows.

    The fit minimises the mean over operating points of a root of squares, so a point with the error
    e weighs 1/e.
    """
    costs = np.maximum(problem.costs(x[None], objective)[0], MODEL_FLOOR**2)
    factors = []
    for residual, deviation, cost in zip(
        problem.residuals(objective), deviations, costs, strict=True
    ):
        factor = (residual.weight * deviation).ravel() / cost**0.25
        factors += [factor, factor]
    return np.concatenate(factors)


def _sparse_basis(directions: np.ndarray) -> np.ndarray:
    """The same null space, with as few parameters per direction as elimination gives."""
    basis = directions.copy()
    used: list[int] = []
    for column in range(basis.shape[1]):
        free = [row for row in range(len(basis)) if row not in used]
        row = max(free, key=lambda one: abs(basis[one, column]))
        used.append(row)
        basis[:, column] /= basis[row, column]
        for other in range(basis.shape[1]):
            if other != column:
                basis[:, other] -= basis[row, other] * basis[:, column]
    return basis


def _named(direction: np.ndarray, labels: Sequence[str]) -> dict[str, float]:
    largest = np.abs(direction).max()
    return {
        label: float(value / largest)
        for label, value in zip(labels, direction, strict=True)
        if abs(value) > 1e-4 * largest
    }


def _sentence(direction: dict[str, float]) -> str:
    names, values = list(direction), np.array(list(direction.values()))
    if len(names) == 1:
        return f"{names[0]} has no effect on the response; its value is arbitrary"
    if np.allclose(values, values[0], rtol=1e-3):
        return f"{_listed(names)} scale together; only their ratios are visible"
    if np.allclose(np.abs(values), abs(values[0]), rtol=1e-3):
        up = [name for name, value in direction.items() if value > 0]
        down = [name for name, value in direction.items() if value < 0]
        return f"{_listed(up)} against {_listed(down)}: only their products are visible"
    parts = [f"{name} by {100 * value:+.3g} %" for name, value in direction.items()]
    return (
        f"changing {_listed(parts)} together changes no response; only what stays the same is "
        "visible"
    )


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


#: Minima with a chi2 this far above the best weigh 2 % and are left out.
FARTHEST = 8.0
#: Norm of the difference of two responses, in standard deviations of the noise, below which they
#: are one minimum.
SAME = 0.3
#: So many are kept, the likeliest.
MOST = 12


@dataclass(frozen=True, eq=False)
class Minimum:
    """x (P,) and the chi2 above that of the reported answer (at least 0)."""

    x: np.ndarray
    above: float


def other_minima(
    problem: Problem,
    x: np.ndarray,
    finished: Sequence[LocalMinimum],
    deviations: Sequence[np.ndarray],
) -> tuple[Minimum, ...]:
    """Ends of a fit within `FARTHEST` of its answer x (P,), the likeliest first; `deviations` (K,
    2, 2) of the noise by point.
    """

    def whitened(x: np.ndarray) -> np.ndarray:
        rows = [
            ((response - point.admittance) / deviation).ravel()
            for response, point, deviation in zip(
                problem.responses(x), problem.points, deviations, strict=True
            )
        ]
        return np.concatenate(rows)

    best = whitened(x)
    chi2 = float((np.abs(best) ** 2).sum())
    least = min((end.error for end in finished), default=0.0)
    worth = least * (1.0 + 2.0 * FARTHEST / max(chi2, 1.0))
    candidates = [
        (end.x, residual, max(float((np.abs(residual) ** 2).sum()) - chi2, 0.0))
        for end in finished
        if end.error <= worth and np.isfinite(residual := whitened(end.x)).all()
    ]
    kept, seen = [], [best]
    for end_x, residual, above in sorted(candidates, key=lambda end: end[2]):
        if (
            above < FARTHEST
            and len(kept) < MOST
            and min(np.linalg.norm(residual - other) for other in seen) > SAME
        ):
            kept.append(Minimum(end_x, above))
            seen.append(residual)
    return tuple(kept)
