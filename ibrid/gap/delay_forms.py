"""The form in which a device has its delays, as a hypothesis beside all others: tried, told, and
part of every interval.
"""

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
#: Forms of a model's delays, the best by a glance, that are refitted.
REDRAWN = 2


def find_lost_forms(given: Diagram, edits: Sequence[Insertion | Convention]) -> tuple[int, ...]:
    """Places of the forms among edits of a given diagram of which the last diagram has nothing
    left: another form came later, or the delay went. What was done to such a delay is to be told of
    the given one.
    """
    before = _kinds_by_name(given)
    after = next(
        (_kinds_by_name(edit.diagram) for edit in reversed(edits) if isinstance(edit, Insertion)),
        before,
    )
    left = {name: kind for name, kind in after.items() if before.get(name) != kind}
    lost = list[int]()
    for place, edit in enumerate(edits):
        if isinstance(edit, Convention):
            continue
        now = _kinds_by_name(edit.diagram)
        formed = {name: kind for name, kind in now.items() if before.get(name) != kind}
        if is_delay_form(edit) and not formed.items() & left.items():
            lost.append(place)
        before = now
    return tuple(lost)


def _kinds_by_name(diagram: Diagram) -> dict[str, str]:
    """Kind of each block by its name."""
    return {one.name: one.kind for one in diagram.instances}


def fit_other_delay_forms(
    dataset: "Dataset", model: Model, scale: float, most: int = REDRAWN
) -> list[Model]:
    """A model with its delays in other forms, the best `most` by a glance refitted from its values;
    [] without delays.

    scale : of the noise.
    """
    forms = [edit for edit in dataset.insertions(model) if edit.form]
    glances = [look for edit in forms if (look := dataset.screen_edit(model, edit)) is not None]
    first = rank_by_bic(glances, scale)[:most]
    edits = [look.edits[-1] for look in first]
    refitted = [
        dataset.fit_edit(model, edit, quick=(model.refit.values,))
        for edit in edits
        if is_delay_form(edit)
    ]
    return [trial for trial in refitted if trial is not None]


def find_allowed_delay_forms(
    dataset: "Dataset", model: Model, scale: float, alike: float
) -> list[Model]:
    """A model with its delays in each other form that the data cannot tell from its own: stable,
    and at most `alike` worse by the Bayesian information criterion; in the order of the catalogue,
    which is that on every machine.
    """
    limit = model.bic(scale) + alike
    places = [edit.where for edit in dataset.insertions(model) if edit.form]
    others = fit_other_delay_forms(dataset, model, scale, most=len(places))
    allowed = [other for other in others if other.bic(scale) <= limit and dataset.is_stable(other)]
    return sorted(allowed, key=lambda other: places.index(getattr(other.edits[-1], "where", "")))


def unite_intervals(intervals: Intervals, others: Sequence[Intervals]) -> dict[str, dict[str, Any]]:
    """Intervals that hold whichever form the device has: the union over those of its own and those
    in the other forms.

    A parameter that one of them leaves open is open; one that the others do not have keeps its
    interval.
    """
    return {op: _union(own, [one.get(op, {}) for one in others]) for op, own in intervals.items()}


def _union(own: Mapping[str, Any], others: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    joined = dict[str, Any]()
    for name, interval in own.items():
        ends = [interval, *(other[name] for other in others if name in other)]
        known = [end for end in ends if end is not None]
        joined[name] = (
            [min(low for low, _ in known), max(high for _, high in known)]
            if len(known) == len(ends)
            else None
        )
    return joined
