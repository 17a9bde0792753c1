"""Does an edit predict what it was not fitted to? Frequencies, operating points or records left
out, before and after.
"""

from dataclasses import dataclass, replace

import numpy as np

from ibrid.gap.refitting.model import Model
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.measurement.sweeps.amplitudes import can_be_thinned, thinned
from ibrid.measurement.sweeps.sweep import Sweep


@dataclass(frozen=True)
class ValidationErrors:
    """Root mean square of the whitened residual at data that a refit did not see, 1 when only noise
    is left.
    """

    frequencies: float | None
    points: float | None
    records: float | None = None


#: Factor of a held-out error by which a repair may be worse than what it repairs: noise alone does
#: as much.
WORSE = 1.2
#: Operating points from which on those left out decide; what one alone leaves open, its prediction
#: does not show.
ENOUGH = 3


def predicts_no_worse(before: ValidationErrors, after: ValidationErrors, points: int) -> bool:
    """True when a repair is not worse at data that it was not fitted to.

    points : measured operating points.
    """
    pairs = [(before.frequencies, after.frequencies), (before.records, after.records)]
    if points >= ENOUGH:
        pairs.append((before.points, after.points))
    return all(old is None or (new is not None and new <= WORSE * old) for old, new in pairs)


def cross_validate(refitter: SweepFitter, noise: Noise, model: Model) -> ValidationErrors:
    """Errors of a model where it was not fitted: at every fourth frequency, and at each operating
    point in turn.

    refitter : to the data as the model reads them. noise : of these.
    """
    sweep, thin = refitter.sweep, None
    if can_be_thinned(sweep):
        thin = _validation_error(
            refitter, noise, model, thinned(sweep, hold=False), thinned(sweep, hold=True)
        )
    squares = []
    for name in sweep.names if len(sweep.names) > 1 else ():
        found = _validation_error(refitter, noise, model, sweep.without([name]), sweep.only([name]))
        squares.append(np.nan if found is None else found**2)
    points = float(np.sqrt(np.mean(squares))) if squares and np.isfinite(squares).all() else None
    return ValidationErrors(thin, points)


def _validation_error(
    refitter: SweepFitter, noise: Noise, model: Model, seen: Sweep, left: Sweep
) -> float | None:
    refit = refitter.with_noise(replace(noise, sweep=seen)).fit(
        model.diagram, [model.refit.values, {}]
    )
    if refit is None:
        return None
    residuals = (
        refitter.with_noise(replace(noise, sweep=left))
        .evaluate_values(model.diagram, refit.values)
        .residuals
    )
    found = float(
        np.sqrt(np.mean(np.concatenate([np.abs(one.ravel()) ** 2 / 2.0 for one in residuals])))
    )
    return found if np.isfinite(found) else None
