"""A simulation in another tool, of which only the sweep is known: where it differs from the
measurement, and which built-in model it is.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.grade import normal_score
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.gap.refitting.noise import estimate_noise
from ibrid.gap.results.gap import LocatedMisfit
from ibrid.gap.results.misfit_location import sum_by_part
from ibrid.measurement.sweeps.interpolating import common_points, interpolated
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.structure.diagrams.library import textbook, textbook_names

#: NRMSE up to which a built-in model counts as the simulation itself, and up to which as close.
SAME = 1e-4
CLOSE = 0.02
#: A brief fit of every built-in model: the first batch of starts mostly solves the right one. Where
#: none is solved, so many of the nearest get a thorough fit.
BRIEF = FitSettings(restarts=0, hops=0, kept_misfit=8)
MOST_THOROUGH = 4
#: Factor on the least NRMSE up to which models fit equally well.
EQUALLY_CLOSE = 1.1


@dataclass(frozen=True)
class IdentifiedModel:
    """The built-in model nearest to a simulated sweep.

    Parameters
    ----------
    words : str
        How near it is, for the steps of the result.
    """

    record: Record
    name: str
    words: str

    @property
    def values(self) -> dict[str, float]:
        """Its parameters, as nominal values."""
        return dict(next(iter(self.record.parameters.values())))


def locate_differences(simulated: Sweep, measured: Sweep) -> tuple[LocatedMisfit, ...]:
    """Locate the difference of two sweeps by operating point, band and entry, largest share first.

    Shares are of the squared difference; the significance is that against the noise of the
    measurement. The simulation is interpolated at the measured frequencies.

    Raises
    ------
    IbridError
        They have no operating point in common.
    """
    common = common_points(simulated, measured)
    if not common:
        raise IbridError(
            f"the two sweeps have no operating point in common, by name or by p, q and v: "
            f"{', '.join(simulated.names)} and {', '.join(measured.names)}"
        )
    noisy = estimate_noise(measured).sweep
    located: list[LocatedMisfit] = []
    for simulated_name, name in common:
        point = simulated.point(simulated_name)
        other = noisy.point(name)
        response = interpolated(point.frequency, point.admittance, other.frequency)
        square = np.abs((response - other.admittance) / np.asarray(other.sigma)) ** 2
        inside = np.isfinite(square).all(axis=(1, 2))
        for band, entry, part, count in sum_by_part(other.frequency[inside], square[inside]):
            z = normal_score(part, 2 * count)
            located.append(LocatedMisfit(name, band, entry, part, z))
    total = sum(part.share for part in located) or 1.0
    shares = [replace(part, share=part.share / total) for part in located]
    return tuple(sorted(shares, key=lambda part: -part.share))


def identify_model(simulated: Sweep, seed: int = 0) -> IdentifiedModel:
    """Identify the built-in model that fits a simulated sweep best.

    Of those that fit equally well the one with fewest parameters.

    Raises
    ------
    IbridError
        None comes close; a search then finds the model.
    """
    records = _fit_built_in(simulated, textbook_names(), seed, BRIEF)
    if not any(_error(record) <= SAME for record in records.values()):
        nearest = sorted(records, key=lambda name: _error(records[name]))[:MOST_THOROUGH]
        records |= _fit_built_in(simulated, nearest, seed, FitSettings())
    if not records:
        raise IbridError(
            "no textbook program fits the simulated sweep; check its conventions with ibrid inspect"
        )
    least = min(_error(record) for record in records.values())
    limit = max(EQUALLY_CLOSE * least, SAME)
    equally_good = {name: record for name, record in records.items() if _error(record) <= limit}
    name = min(equally_good, key=lambda name: equally_good[name].free_parameters)
    error = _error(equally_good[name])
    if error > CLOSE:
        raise IbridError(
            f"no textbook program is close to the simulated sweep (the best is {name}, NRMSE "
            f"{error:.2g}); "
            "find its program with ibrid search, then run ibrid gap with that"
        )
    near = "is" if error <= SAME else "is close to"
    words = f"the simulated sweep {near} the textbook program {name} (NRMSE {error:.2g})"
    return IdentifiedModel(equally_good[name], name, words)


def _error(record: Record) -> float:
    """Return the NRMSE of a record that has one."""
    return float(record.nrmse or 0.0)


def _fit_built_in(
    simulated: Sweep, names: Iterable[str], seed: int, settings: FitSettings
) -> dict[str, Record]:
    """Fit built-in models and return the records of those with a response and stable poles."""
    records = {
        name: evaluate(textbook(name), simulated, seed=seed, settings=settings) for name in names
    }
    return {
        name: record
        for name, record in records.items()
        if record.nrmse is not None and all(record.stable.values())
    }
