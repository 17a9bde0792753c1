"""What an experiment could have seen: how far each effect would move the data beyond what the
parameters take up.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.gap.refitting.sweep_fitter import SweepFit, SweepFitter
from ibrid.gap.results.gap import UndetectableEffect
from ibrid.parts.editing.practice import Effect, Insertion

#: Least noncentrality (chi2) of an effect that an experiment can be expected to show.
SEEN = 15.0


def unseen(
    refitter: SweepFitter,
    model: SweepFit,
    edits: Sequence[Insertion],
    catalogue: Sequence[Effect],
    scale: float,
) -> tuple[UndetectableEffect, ...]:
    """Of the effects that a model lacks those whose typical strength the data would not have shown.

    Law: the noncentrality is |t - J J+ t|^2 with t the whitened change of the response by the
    effect at the middle of its bank, J the whitened slopes by the parameters; below `SEEN` it
    cannot be expected to be found.
    """
    deviations = [np.asarray(point.sigma) for point in model.problem.points]
    parameter_prior = model.parameter_prior.deviation_slope_in_x(model.x)
    rows = np.concatenate(
        [model.problem.white_slopes(model.x, deviations), np.diag(parameter_prior)]
    )
    if not np.isfinite(rows).all():
        return ()
    scales = np.linalg.norm(rows, axis=0)
    basis, values, _ = np.linalg.svd(rows / np.where(scales > 0, scales, 1.0), full_matrices=False)
    basis = basis[:, values > 1e-9 * values[0]] if values.size else basis
    told_apart = {one.id: one.told_apart_by for one in catalogue}
    undetectable = []
    for edit in edits:
        if edit.change != "add" or not edit.parameters or not edit.nothing:
            continue
        middle = {name: bank[len(bank) // 2] for name, bank in edit.parameters.items()}
        try:
            changed = refitter.evaluate_values(edit.diagram, {**model.values, **middle})
        except ArithmeticError:
            continue
        pairs = zip(changed.responses, model.responses, deviations, strict=True)
        moves = [((new - old) / deviation).reshape(-1) for new, old, deviation in pairs]
        move = np.concatenate(
            [part for one in moves for part in (one.real, one.imag)]
            + [np.zeros(model.parameter_count)]
        )
        if not np.isfinite(move).all():
            continue
        left = move - basis @ (basis.T @ move)
        strength = float(left @ left) / scale**2
        if strength < SEEN:
            undetectable.append(
                UndetectableEffect(
                    edit.effect, edit.change, edit.where, strength, told_apart.get(edit.effect, "")
                )
            )
    return tuple(sorted(undetectable, key=lambda one: one.detectability))
