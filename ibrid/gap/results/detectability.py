"""What an experiment could have shown: the change of the data by an effect that no parameter of the
model can take up.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.gap.refitting.sweep_fitter import SweepFit, SweepFitter
from ibrid.gap.results.gap import UndetectableEffect
from ibrid.parts.editing.practice import Effect, Insertion

#: Least noncentrality (chi2) of an effect that an experiment can be expected to show.
DETECTABLE = 15.0
#: Singular values below this part of the largest count as zero.
ZERO_SINGULAR_VALUE = 1e-9


def list_undetectable_effects(
    fitter: SweepFitter,
    fit: SweepFit,
    edits: Sequence[Insertion],
    catalogue: Sequence[Effect],
    scale: float,
) -> tuple[UndetectableEffect, ...]:
    """List effects that a model lacks and that would not be visible at their typical strength.

    Law: the noncentrality is |t - J J+ t|^2, with t the whitened change of the response by the
    effect at the middle of its initial values and J the whitened Jacobian; below `DETECTABLE` the
    effect cannot be expected to be found.

    Parameters
    ----------
    fit : SweepFit
        Of the model.
    edits : sequence of Insertion
        That are tried on the model.
    catalogue : sequence of Effect
        Says which measurement would show an effect.
    scale : float
        Factor on the standard deviation of the noise.
    """
    prior_slope = np.diag(fit.parameter_prior.deviation_slope_in_x(fit.x))
    deviations = [np.asarray(point.sigma) for point in fit.problem.points]
    jacobian = np.concatenate([fit.problem.white_slopes(fit.x, deviations), prior_slope])
    if not np.isfinite(jacobian).all():
        return ()
    basis = identifiable_basis(jacobian)
    advice = {effect.id: effect.told_apart_by for effect in catalogue}
    undetectable: list[UndetectableEffect] = []
    for edit in edits:
        if edit.change != "add" or not edit.parameters or not edit.nothing:
            continue
        change = _change_by_edit(fitter, fit, edit, deviations)
        if change is None:
            continue
        strength = unexplained_change(change, basis) / scale**2
        if strength < DETECTABLE:
            undetectable.append(
                UndetectableEffect(
                    edit.effect, edit.change, edit.where, strength, advice.get(edit.effect, "")
                )
            )
    return tuple(sorted(undetectable, key=lambda effect: effect.detectability))


def identifiable_basis(jacobian: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (R, r) of what parameters can change, of a Jacobian (R, P)."""
    norms = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(norms > 0, norms, 1.0)
    basis, values, _ = np.linalg.svd(scaled, full_matrices=False)
    if not values.size:
        return basis
    return basis[:, values > ZERO_SINGULAR_VALUE * values[0]]


def unexplained_change(change: np.ndarray, basis: np.ndarray) -> float:
    """Return the squared norm of a whitened change (R,) outside of a basis (R, r)."""
    remainder = change - basis @ (basis.T @ change)
    return float(remainder @ remainder)


def _change_by_edit(
    fitter: SweepFitter, fit: SweepFit, edit: Insertion, deviations: Sequence[np.ndarray]
) -> np.ndarray | None:
    """Return the whitened change (R,) of all residuals by an effect of typical strength.

    None where the response is not finite.
    """
    typical = {name: values[len(values) // 2] for name, values in edit.parameters.items()}
    try:
        changed = fitter.evaluate_values(edit.diagram, {**fit.values, **typical})
    except ArithmeticError:
        return None
    parts: list[np.ndarray] = []
    for new, old, deviation in zip(changed.responses, fit.responses, deviations, strict=True):
        whitened = ((new - old) / deviation).reshape(-1)
        parts += [whitened.real, whitened.imag]
    change = np.concatenate([*parts, np.zeros(fit.parameter_count)])
    return change if np.isfinite(change).all() else None
