"""A simulation that lives in another tool: its sweep instead of a program. Where it differs, and
which program it is.
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
from ibrid.gap.results.misfit_location import by_part
from ibrid.measurement.sweeps.interpolating import common_points, interpolated
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.structure.diagrams.library import textbook, textbook_names

#: NRMSE up to which a textbook program is taken for the simulation itself, and up to which it is
#: close.
SAME, CLOSE = 1e-4, 0.02
#: A first look at every textbook program: the right one is mostly solved by the first wave of
#: starts. Where none is, so many of the nearest are fitted with care.
QUICK, NEAREST = FitSettings(restarts=0, hops=0, kept_misfit=8), 4


@dataclass(frozen=True)
class Identified:
    """The textbook program nearest to a simulated sweep.

    `words` : how near, for the steps of the answer.
    """

    record: Record
    name: str
    words: str

    @property
    def values(self) -> dict[str, float]:
        """Its parameters, as nominal values."""
        return dict(next(iter(self.record.parameters.values())))


def differences(simulated: Sweep, measured: Sweep) -> tuple[LocatedMisfit, ...]:
    """Where two sweeps differ: share of the squared difference by operating point, band and entry,
    and its significance against the noise of the measurement. At frequencies that both have, else
    the simulation is interpolated.

    Raises IbridError when they have no operating point in common.
    """
    common = common_points(simulated, measured)
    if not common:
        raise IbridError(
            f"the two sweeps have no operating point in common, by name or by p, q and v: "
            f"{', '.join(simulated.names)} and {', '.join(measured.names)}"
        )
    located, noise = [], estimate_noise(measured).sweep
    for simulated_as, name in common:
        point, other = simulated.point(simulated_as), noise.point(name)
        response = interpolated(point.frequency, point.admittance, other.frequency)
        square = np.abs((response - other.admittance) / np.asarray(other.sigma)) ** 2
        inside = np.isfinite(square).all(axis=(1, 2))
        for edges, entry, part, count in by_part(other.frequency[inside], square[inside]):
            located.append(LocatedMisfit(name, edges, entry, part, normal_score(part, 2 * count)))
    whole = sum(one.share for one in located) or 1.0
    return tuple(
        sorted(
            (replace(one, share=one.share / whole) for one in located), key=lambda one: -one.share
        )
    )


def identify(simulated: Sweep, seed: int = 0) -> Identified:
    """The textbook program that fits a simulated sweep best; of those that fit alike the one with
    fewest parameters.

    Raises IbridError when none comes close: then a search finds the program.
    """
    able = _fitted(simulated, textbook_names(), seed, QUICK)
    if not any(float(one.nrmse or 0.0) <= SAME for one in able.values()):
        nearest = sorted(able, key=lambda name: float(able[name].nrmse or 0.0))[:NEAREST]
        able |= _fitted(simulated, nearest, seed, FitSettings())
    if not able:
        raise IbridError(
            "no textbook program fits the simulated sweep; check its conventions with ibrid inspect"
        )
    best = min(float(one.nrmse or 0.0) for one in able.values())
    alike = {
        name: one for name, one in able.items() if float(one.nrmse or 0.0) <= max(1.1 * best, SAME)
    }
    name = min(alike, key=lambda each: alike[each].free_parameters)
    error = float(alike[name].nrmse or 0.0)
    if error > CLOSE:
        raise IbridError(
            f"no textbook program is close to the simulated sweep (the best is {name}, NRMSE "
            f"{error:.2g}); "
            "find its program with ibrid search, then run ibrid gap with that"
        )
    near = "is" if error <= SAME else "is close to"
    return Identified(
        alike[name],
        name,
        f"the simulated sweep {near} the textbook program {name} (NRMSE {error:.2g})",
    )


def _fitted(
    simulated: Sweep, names: Iterable[str], seed: int, settings: FitSettings
) -> dict[str, Record]:
    """Of textbook programs those that have a fit with a stable model."""
    records = {
        name: evaluate(textbook(name), simulated, seed=seed, settings=settings) for name in names
    }
    return {
        name: one
        for name, one in records.items()
        if one.nrmse is not None and all(one.stable.values())
    }
