"""The form in which a device has its delays (such as Pade or exact), as an edit of a model."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ibrid.gap.refitting.model import Model, is_delay_form, rank_by_bic
from ibrid.measurement.conventions.labels import Convention
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.diagrams.diagram import Diagram

if TYPE_CHECKING:
    from ibrid.gap.datasets.dataset import Dataset

#: Operating point -> parameter -> interval.
Intervals = Mapping[str, Mapping[str, Any]]
#: Forms that are refitted, the best by screening.
REFITTED_FORMS = 2


def find_lost_forms(given: Diagram, edits: Sequence[Insertion | Convention]) -> tuple[int, ...]:
    """Return the positions of forms of which a later edit left nothing.

    Another form replaced them, or the delay was removed.

    Parameters
    ----------
    given : Diagram
        To which the edits were applied in order.
    """
    before = _kinds_by_name(given)
    after = next(
        (_kinds_by_name(edit.diagram) for edit in reversed(edits) if isinstance(edit, Insertion)),
        before,
    )
    changed_in_all = {name: kind for name, kind in after.items() if before.get(name) != kind}
    lost: list[int] = []
    for position, edit in enumerate(edits):
        if isinstance(edit, Convention):
            continue
        kinds = _kinds_by_name(edit.diagram)
        changed = {name: kind for name, kind in kinds.items() if before.get(name) != kind}
        if is_delay_form(edit) and not changed.items() & changed_in_all.items():
            lost.append(position)
        before = kinds
    return tuple(lost)


def _kinds_by_name(diagram: Diagram) -> dict[str, str]:
    """Return the kind of each block by its name."""
    return {block.name: block.kind for block in diagram.instances}


def fit_other_delay_forms(
    dataset: "Dataset", model: Model, scale: float, most: int = REFITTED_FORMS
) -> list[Model]:
    """Fit a model with its delays in other forms; [] without delays.

    Parameters
    ----------
    scale : float
        Factor on the standard deviation of the noise.
    most : int
        Forms that are refitted from the values of the model, the best by screening.
    """
    forms = [edit for edit in dataset.insertions(model) if edit.form]
    screened = [dataset.screen_edit(model, edit) for edit in forms]
    ranked = rank_by_bic((fit for fit in screened if fit is not None), scale)
    edits = [fit.edits[-1] for fit in ranked[:most]]
    refitted = [
        dataset.fit_edit(model, edit, quick=(model.refit.values,))
        for edit in edits
        if is_delay_form(edit)
    ]
    return [trial for trial in refitted if trial is not None]


def find_allowed_delay_forms(
    dataset: "Dataset", model: Model, scale: float, equally_good: float
) -> list[Model]:
    """Fit a model with its delays in each other form that the data do not exclude.

    Those are stable and at most `equally_good` worse by the Bayesian information criterion. In the
    order of the catalogue, which is the same on every machine.
    """
    limit = model.bic(scale) + equally_good
    locations = [edit.where for edit in dataset.insertions(model) if edit.form]
    others = fit_other_delay_forms(dataset, model, scale, most=len(locations))
    allowed = [other for other in others if other.bic(scale) <= limit and dataset.is_stable(other)]
    return sorted(allowed, key=lambda other: locations.index(getattr(other.edits[-1], "where", "")))


def unite_intervals(intervals: Intervals, others: Sequence[Intervals]) -> dict[str, dict[str, Any]]:
    """Unite confidence intervals, so that they hold whichever form the device has.

    A parameter that is open in one form is open; one that the other forms do not have keeps its
    interval.
    """
    return {
        op: _unite(own, [other.get(op, {}) for other in others]) for op, own in intervals.items()
    }


def _unite(own: Mapping[str, Any], others: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Unite the intervals of one operating point."""
    united: dict[str, Any] = {}
    for name, interval in own.items():
        intervals = [interval, *(other[name] for other in others if name in other)]
        if any(interval is None for interval in intervals):
            united[name] = None
        else:
            united[name] = [
                min(low for low, _ in intervals),
                max(high for _, high in intervals),
            ]
    return united
