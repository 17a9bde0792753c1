"""The linearity gate: where the response to a large injection differs from that to a small one by
more than noise does.

A small-signal model speaks of the limit of small amplitudes. Products of signals change a response
with the square of the amplitude even where every controller is linear; what goes beyond that is a
limit, a dead zone, a dead time.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, ndtri

from ibrid.frozen import Frozen
from ibrid.measurement.sweeps.amplitudes import at_amplitudes, levels_of
from ibrid.measurement.sweeps.noise import estimate_point, of_norm
from ibrid.measurement.sweeps.quantities import hertz, span
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, Sweep

#: Probability of one false alarm in all operating points, frequencies and entries of a measurement.
FALSE_ALARM = 1e-3


@dataclass(frozen=True)
class AmplitudeDependence:
    """A band in which an entry depends on the amplitude. `band` : its first and last measured
    frequency, Hz.
    `z` : of its most significant frequency, in standard deviations. `change` : largest difference
    between two amplitudes over |Y|_F. `amplitudes` : smallest and largest of the band. `products` :
    True where it is no larger than what products and rotations of a linear controller cause.
    """

    op: str
    band: tuple[float, float]
    entry: str
    z: float
    change: float
    amplitudes: tuple[float, float]
    products: bool


@dataclass(frozen=True, eq=False)
class Linearity(Frozen):
    """What several amplitudes say. `amplitudes` : of each level, the smallest of its sweep,
    ascending. `bands` : where the response depends on them, the most significant first. `refused` :
    (R,) Hz at which no small-signal answer can be had.
    `noise` : what differences were weighed by, in words. `tests` : how many of them there were.
    """

    amplitudes: tuple[float, ...]
    bands: tuple[AmplitudeDependence, ...]
    refused: np.ndarray
    noise: str
    tests: int

    @property
    def sentence(self) -> str:
        """One sentence for people."""
        levels = ", ".join(f"{one:g}" for one in self.amplitudes)
        response = f"Swept with {len(self.amplitudes)} amplitudes ({levels}): the response"
        if not self.bands:
            return f"{response} is the same within the noise."
        strong = len(self.refused) > 0
        edges = self.refused if strong else [edge for one in self.bands for edge in one.band]
        low, high = min(edges), max(edges)
        where = f"from {span(low, high)}" if hertz(low) != hertz(high) else f"at {hertz(low)}"
        if strong:
            return f"{response} depends on them {where}; no small-signal model holds there."
        return (
            f"{response} changes with them {where}, no more than products of signals make it; the "
            "smallest amplitude is "
            "small enough."
        )


def linearity(sweep: Sweep) -> Linearity | None:
    """Compare all amplitudes; None for a sweep with one.

    Law: at each operating point, frequency and entry, sum |Y_l - mean|^2 / s_l^2 over the L
    amplitudes follows chi2 with 2 (L - 1) degrees of freedom under noise alone, s_l of each real
    and imaginary part; an entry depends on the amplitude where that is less likely than FALSE_ALARM
    over the number of tests. A frequency is refused, at all operating points, where it is still so
    with PRODUCTS a^2 max(1, |Y|)^2 |Y|_F added to the noise as the rms error of the matrix.

    The noise is the sigma of the data, else that of the repeats, else their roughness on dense
    grids, else UNKNOWN |Y|_F.
    """
    levels = at_amplitudes(sweep)
    if len(levels) < 2:
        return None
    cells = [cell for point in sweep.points if point.larger for cell in _cells(point)]
    limit = FALSE_ALARM / (len(ENTRIES) * max(len(cells), 1))
    refused = sorted({cell.frequency for cell in cells if (cell.p_products < limit).any()})
    sources = {estimate_point(level).source for point in sweep.points for level in levels_of(point)}
    return Linearity(
        amplitudes=tuple(
            min(
                np.nan if one.amplitude is None else float(one.amplitude.min())
                for one in level.points
            )
            for level in levels
        ),
        bands=tuple(sorted(_bands(cells, limit), key=lambda one: (one.products, -one.z))),
        refused=np.array(refused),
        noise=f"unknown, taken as {100 * UNKNOWN:g} % of |Y|"
        if "unknown" in sources
        else " and ".join(sorted(sources)),
        tests=len(ENTRIES) * len(cells),
    )


def small_signal(sweep: Sweep, dependence: Linearity) -> Sweep | None:
    """The sweep of the smallest amplitude without the frequencies that are refused; None where a
    point has none left.

    Where the response depends on the amplitude at all, a known sigma is widened by what products
    may add at the smallest.
    """
    points = []
    for point in at_amplitudes(sweep)[0].points:
        kept = ~np.isin(point.frequency, dependence.refused)
        if not kept.any():
            return None
        known = estimate_point(point).sigma is not None
        wide = replace(with_products(point), repeats=None) if dependence.bands and known else point
        points.append(wide.at(kept))
    return replace(sweep, points=tuple(points))


# --- cells
# ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Cell:
    """One operating point and frequency. `p`, `p_products` : (4,) by entry, of noise alone and with
    products. `z` : (4,).
    `change` : (4,) over |Y|_F.
    """

    op: str
    frequency: float
    p: np.ndarray
    p_products: np.ndarray
    z: np.ndarray
    change: np.ndarray
    amplitudes: tuple[float, float]


def _cells(point: PointSweep) -> Iterator[_Cell]:
    levels = levels_of(point)
    noise, wide = (
        [sigma_of(one) for one in levels],
        [np.asarray(with_products(one).sigma) for one in levels],
    )
    for k, frequency in enumerate(point.frequency):
        present = [
            (j, int(np.flatnonzero(one.frequency == frequency)[0]))
            for j, one in enumerate(levels)
            if frequency in one.frequency
        ]
        if len(present) < 2:
            continue
        values = np.array([levels[j].admittance[place].ravel() for j, place in present])
        p, z = _tested(values, np.array([noise[j][place].ravel() for j, place in present]))
        p_products, _ = _tested(values, np.array([wide[j][place].ravel() for j, place in present]))
        amplitudes = [float(np.asarray(levels[j].amplitude)[place]) for j, place in present]
        change = np.abs(values[:, None] - values[None]).max(axis=(0, 1)) / float(
            np.linalg.norm(point.admittance[k])
        )
        ends = min(amplitudes), max(amplitudes)
        yield _Cell(point.op.name, float(frequency), p, p_products, z, change, ends)


def _tested(values: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """p values and standard deviations (4,) of L values (L, 4) being the same, each part with sigma
    (L, 4).
    """
    weight = sigma**-2.0
    mean = (weight * values).sum(axis=0) / weight.sum(axis=0)
    square, dof = (weight * np.abs(values - mean) ** 2).sum(axis=0), 2.0 * (len(values) - 1)
    deviations = ((square / dof) ** (1 / 3) - (1 - 2 / (9 * dof))) / np.sqrt(
        2 / (9 * dof)
    )  # Wilson and Hilferty
    p = chdtrc(dof, square)
    return p, np.where(p > 1e-300, -ndtri(np.maximum(p, 1e-300)), deviations)


def _bands(cells: list[_Cell], limit: float) -> Iterator[AmplitudeDependence]:
    """Neighbouring frequencies of one operating point and entry that depend on the amplitude."""
    for op in dict.fromkeys(cell.op for cell in cells):
        mine = [cell for cell in cells if cell.op == op]
        for number, entry in enumerate(ENTRIES):
            run: list[_Cell] = []
            for cell in [*mine, None]:
                if cell is not None and cell.p[number] < limit:
                    run.append(cell)
                elif run:
                    yield _band(run, number, entry, limit)
                    run = []


def _band(run: list[_Cell], number: int, entry: str, limit: float) -> AmplitudeDependence:
    return AmplitudeDependence(
        op=run[0].op,
        band=(run[0].frequency, run[-1].frequency),
        entry=entry,
        z=float(max(cell.z[number] for cell in run)),
        change=float(max(cell.change[number] for cell in run)),
        amplitudes=(
            min(cell.amplitudes[0] for cell in run),
            max(cell.amplitudes[1] for cell in run),
        ),
        products=all(cell.p_products[number] >= limit for cell in run),
    )


#: rms error of the matrix over |Y|_F that a sweep of unknown noise is taken to have.
UNKNOWN = 5e-3
#: Change of the matrix over |Y|_F that products and rotations cause, over the square of the larger
#: amplitude of voltage and current, per unit.
PRODUCTS = 1.0


def with_products(point: PointSweep) -> PointSweep:
    """A point whose sigma (K, 2, 2) holds what products and rotations may add at its amplitude."""
    sigma = sigma_of(point)
    if point.amplitude is None:
        return replace(point, sigma=sigma)
    largest = point.amplitude * np.maximum(
        np.linalg.norm(point.admittance, ord=2, axis=(1, 2)), 1.0
    )
    return replace(point, sigma=np.hypot(sigma, of_norm(point, PRODUCTS * largest**2)))


def sigma_of(point: PointSweep) -> np.ndarray:
    """Standard deviation of each part (K, 2, 2): as known, else an rms error of the matrix of
    UNKNOWN |Y|_F.
    """
    known = estimate_point(point).sigma
    return of_norm(point, UNKNOWN) if known is None else known
