"""Sparse regression: of a library of terms the few that explain the data, with their coefficients.

Sequentially thresholded least squares (S. L. Brunton, J. L. Proctor and J. N. Kutz, PNAS 113 (2016)
3932) with the threshold such that one term falls at a time, the one whose removal costs least (L.
Boninsegna, F. Nueske and C. Clementi, J. Chem. Phys. 148 (2018) 241723), because columns of a
library of lags are nearly parallel and a common threshold cuts both of a pair. For the same reason
its competitor, orthogonal least squares, which adds the most useful term each time (S. Chen, S. A.
Billings and W. Luo, Int. J. Control 50 (1989) 1873), is tried too; of all sets on both ways an
information criterion chooses, and what it chose is thresholded once more.
"""

from dataclasses import dataclass

import numpy as np
from ibrid_bench.baselines.weighing import information

from ibrid.errors import IbridError

#: Damping of the normal equations of columns of length 1, so that parallel columns share instead of
#: cancelling.
RIDGE = 1e-8
#: A term of which no more is left than this, when what others give is taken away, adds nothing.
PARALLEL = 1e-5
#: Share of the measured numbers that the terms may reach.
SHARE = 0.25


@dataclass(frozen=True, eq=False)
class Selection:
    """The terms that remain.

    chosen : their places in the library, ascending. coefficients : (len(chosen),).
    """

    chosen: tuple[int, ...]
    coefficients: np.ndarray


def sparse_regression(columns: np.ndarray, target: np.ndarray, *, known: bool) -> Selection:
    """Minimise |columns c - target| with few c that are not zero; how few the Bayesian information
    criterion says.

    columns : (n, T) real, what each term gives. target : (n,). Both divided by `scales`; known :
    whether these are the noise. Raises IbridError when shapes disagree or a term gives nothing at
    all.
    """
    if columns.ndim != 2 or target.shape != columns.shape[:1] or not columns.size:
        raise IbridError(
            f"a regression needs (n, T) columns and (n,) targets; found {columns.shape} and "
            f"{target.shape}, "
            "stack the rows of all operating points in the same order"
        )
    size = np.linalg.norm(columns, axis=0)
    if not (size > 0).all():
        raise IbridError(
            f"every term must give something; term {int(size.argmin())} is zero throughout, leave "
            "it out of the library"
        )
    unit = columns / size
    most = max(1, int(SHARE * len(target)))

    def merit(kept: list[int]) -> float:
        error = target - unit[:, kept] @ _fitted(unit[:, kept], target)
        return information(error, len(kept), known)

    best = min((*_thresholded(unit, target, most), *_added(unit, target, most)), key=merit)
    thinner = (
        [best[place] for place in kept] for kept in _thresholded(unit[:, best], target, most)
    )
    best = min(thinner, key=merit)
    return Selection(tuple(best), _fitted(unit[:, best], target) / size[best])


def _fitted(unit: np.ndarray, target: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(unit, target, rcond=None)[0]


def _thresholded(unit: np.ndarray, target: np.ndarray, most: int) -> list[list[int]]:
    """Sets of `most` terms down to one; what a removal costs is c_k^2 / (G^-1)_kk, G the damped
    Gram matrix.
    """
    kept = list(range(unit.shape[1]))
    inverse = np.linalg.inv(unit.T @ unit + RIDGE * np.eye(len(kept)))
    moments = unit.T @ target
    sets = [list(kept)]
    while len(kept) > 1:
        fitted = inverse @ moments[kept]
        worst = int((fitted**2 / np.diag(inverse)).argmin())
        rest = np.delete(np.arange(len(kept)), worst)
        edge = inverse[rest, worst]
        inverse = inverse[np.ix_(rest, rest)] - np.outer(edge, edge) / inverse[worst, worst]
        del kept[worst]
        sets.append(list(kept))
    return [one for one in sets if len(one) <= most]


def _added(unit: np.ndarray, target: np.ndarray, most: int) -> list[list[int]]:
    """Sets of one term up to `most`; what an addition gains is the part of the rest of the target
    along what is new in it.
    """
    sets: list[list[int]] = [[]]
    new, rest = unit.copy(), target.copy()
    while len(sets) <= min(most, unit.shape[1]):
        size = np.linalg.norm(new, axis=0)
        gain = np.where(size > PARALLEL, np.abs(new.T @ rest) / np.maximum(size, PARALLEL), 0.0)
        best = int(gain.argmax())
        if gain[best] == 0.0:
            break
        direction = new[:, best] / size[best]
        new = new - np.outer(direction, direction @ new)
        rest = rest - direction * (direction @ rest)
        sets.append([*sets[-1], best])
    return [sorted(one) for one in sets[1:]]
