"""Which nonlinearity, if any, explains how a response depends on the amplitude: all places fitted, weighed, decided."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ibrid.gap.noise import ADEQUATE, Noise
from ibrid.gap.nonlinear_data import AmplitudeData
from ibrid.gap.nonlinear_fit import NonlinearFit, NonlinearSearch
from ibrid.gap.nonlinear_places import places
from ibrid.gap.prior import Prior
from ibrid.gap.refit import Refit, Refitter
from ibrid.gap.trial import ALIKE, threshold
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagram import Diagram
from ibrid.telling import Count, untold

#: Random starts of the linear model, whose parameters the fits begin with.
DRAWS = 32


@dataclass(frozen=True, eq=False)
class Naming:
    """`linear` : the linear model fitted to all amplitudes, `linear_cost` : its chi2 and prior. `fits` : of every place, the
    best first. `best` : the one that is believed, None where no one is. `alike` : others that these data cannot tell from
    it. `threshold` : the gain in cost that chance alone would reach once in a thousand searches."""

    linear: Refit
    linear_cost: float
    fits: tuple[NonlinearFit, ...]
    best: NonlinearFit | None
    alike: tuple[NonlinearFit, ...]
    threshold: float

    @property
    def named(self) -> bool:
        """True when what is believed is an effect with a name, and so is all that cannot be told from it."""
        return self.best is not None and all(one.place.id for one in (self.best, *self.alike))


def name_nonlinearity(
    diagram: Diagram,
    kinds: Vocabulary,
    data: AmplitudeData,
    prior: Prior,
    rng: np.random.Generator,
    tell: Count = untold,
) -> Naming | None:
    """Fit every nonlinearity at every place of a model; None where the linear model has no response.

    One is believed when its likelihood ratio against the linear model passes the threshold of all tests, and its fit is
    adequate for errors that grow with the measured distortion. Others within `ALIKE` of its cost cannot be told from it.
    """
    tell(0, 1, "the linear model at all amplitudes")
    linear = Refitter(Noise(data.pooled, True, ""), kinds, prior, rng).refit(diagram, [{}], draws=DRAWS)
    if linear is None:
        return None
    candidates, fits = places(diagram, kinds), []
    for number, place in enumerate(candidates):
        tell(number, len(candidates), place.words)
        found = NonlinearSearch(place, diagram, kinds, data, prior).best([linear.values, {}])
        if found is not None:
            fits.append(found)
    fits.sort(key=lambda one: one.cost)
    cost, limit = linear.cost + data.within, threshold(1, len(fits))
    best = next((one for one in fits if believed(one, cost - limit)), None)
    alike = () if best is None else tuple(_others(best, fits, cost - limit))
    return Naming(linear, cost, tuple(fits), best, alike, limit)


def believed(fit: NonlinearFit, most: float) -> bool:
    """True for a fit that costs no more than `most`, is adequate, and whose threshold lies inside its box."""
    low, high = fit.interval
    seen = np.isfinite(high) and high < 10.0 * fit.threshold and low > 0.1 * fit.threshold
    return bool(fit.cost < most and fit.p_value > ADEQUATE and seen and fit.state.motion.converged.all())


def _others(best: NonlinearFit, fits: Sequence[NonlinearFit], most: float) -> list[NonlinearFit]:
    """The best other of each effect or nameless place within reach of the best, that effect itself apart."""
    found: dict[str, NonlinearFit] = {}
    for one in fits:
        key = one.place.id or one.place.words
        if one is not best and key != best.place.id and one.cost < best.cost + ALIKE and believed(one, most):
            found.setdefault(key, one)
    return list(found.values())
