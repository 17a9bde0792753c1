"""Cross-validation: whether an edit predicts data that it was not fitted to.

Frequencies, operating points or records are left out, before and after the edit.
"""

from dataclasses import dataclass, replace

import numpy as np

from ibrid.gap.refitting.model import Model
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.refitting.sweep_fitter import SweepFitter
from ibrid.measurement.sweeps.amplitudes import can_be_thinned, thinned
from ibrid.measurement.sweeps.sweep import Sweep

#: Factor on a validation error by which a repair may be worse than the given model: noise alone
#: does as much.
LARGEST_RATIO = 1.2
#: Operating points from which on those left out decide: with fewer, what one alone determines is
#: not predicted.
LEAST_POINTS = 3


@dataclass(frozen=True)
class ValidationErrors:
    """Root mean square of the whitened residual on data that a refit did not use.

    1 where only noise is left; None where that part was not tested.
    """

    frequencies: float | None
    points: float | None
    records: float | None = None


def predicts_no_worse(before: ValidationErrors, after: ValidationErrors, points: int) -> bool:
    """Whether a repair is not worse on data that it was not fitted to.

    points : measured operating points.
    """
    pairs = [(before.frequencies, after.frequencies), (before.records, after.records)]
    if points >= LEAST_POINTS:
        pairs.append((before.points, after.points))
    return all(
        old is None or (new is not None and new <= LARGEST_RATIO * old) for old, new in pairs
    )


def cross_validate(fitter: SweepFitter, noise: Noise, model: Model) -> ValidationErrors:
    """Refit a model on parts of a sweep and return its error on the parts left out.

    Every fourth frequency, and each operating point in turn.

    Parameters
    ----------
    fitter : SweepFitter
        To the data as the model reads them.
    noise : Noise
        Of these.
    """
    sweep = fitter.sweep
    frequency_error = None
    if can_be_thinned(sweep):
        training = thinned(sweep, hold=False)
        frequency_error = _validation_error(
            fitter, noise, model, training, thinned(sweep, hold=True)
        )
    squares: list[float] = []
    for name in sweep.names if len(sweep.names) > 1 else ():
        training = sweep.without([name])
        error = _validation_error(fitter, noise, model, training, sweep.only([name]))
        squares.append(np.nan if error is None else error**2)
    point_error = None
    if squares and np.isfinite(squares).all():
        point_error = float(np.sqrt(np.mean(squares)))
    return ValidationErrors(frequency_error, point_error)


def _validation_error(
    fitter: SweepFitter, noise: Noise, model: Model, training: Sweep, validation: Sweep
) -> float | None:
    """Refit on one part and return the rms whitened residual on the other; None without one."""
    training_fitter = fitter.with_noise(replace(noise, sweep=training))
    refit = training_fitter.fit(model.diagram, [model.refit.values, {}])
    if refit is None:
        return None
    validation_fitter = fitter.with_noise(replace(noise, sweep=validation))
    residuals = validation_fitter.evaluate_values(model.diagram, refit.values).residuals
    squares = [np.abs(residual.ravel()) ** 2 / 2.0 for residual in residuals]
    error = float(np.sqrt(np.mean(np.concatenate(squares))))
    return error if np.isfinite(error) else None
