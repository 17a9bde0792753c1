"""A repaired model without one of its edits, the others done to what is then there."""

from collections.abc import Sequence
from dataclasses import replace

from ibrid.gap.datasets.dataset import Dataset
from ibrid.gap.datasets.sweep_dataset import TRIAL_DRAWS
from ibrid.gap.delay_forms import find_lost_forms
from ibrid.gap.refitting.model import Model
from ibrid.measurement.conventions.labels import Convention
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.diagram import Diagram


def drop_lost_forms(dataset: Dataset, given: Model, best: Model) -> Model:
    """The same device without the form of a delay that went later: what was done to that is then
    told of the given model.
    """
    for place in reversed(find_lost_forms(given.diagram, best.edits)):
        alone = refit_without_edit(dataset, given, best, place)
        if alone is not None and _structure(dataset, alone) == _structure(dataset, best):
            best = alone
    return best


def refit_without_edit(dataset: Dataset, given: Model, best: Model, place: int) -> Model | None:
    """The repaired model without one of its edits, refitted; None where the others do not apply
    without it.
    """
    model, done = given, ()
    before = given.diagram
    for number, edit in enumerate(best.edits):
        taken = _removed_blocks(before, edit)
        before = before if isinstance(edit, Convention) else edit.diagram
        if number == place:
            continue
        if isinstance(edit, Convention):
            model = replace(model, convention=edit, extra=best.extra)
        else:
            twin = _find_same_edit(dataset.insertions(model), model.diagram, edit, taken)
            if twin is None:
                return None
            model, edit = replace(model, diagram=twin.diagram), twin
        done = (*done, edit)
    return dataset.refit_model(
        replace(model, edits=done), [best.refit.values, {}], draws=TRIAL_DRAWS
    )


def _find_same_edit(
    edits: Sequence[Insertion], diagram: Diagram, edit: Insertion, taken: frozenset[str]
) -> Insertion | None:
    """Of edits of a diagram the one that does what an edit did to another; by its name, or by the
    blocks that it takes away.
    """
    same = (edit.effect, edit.change, edit.where)
    named = next((one for one in edits if (one.effect, one.change, one.where) == same), None)
    if named is not None or edit.change != "remove" or not taken:
        return named
    return next(
        (one for one in edits if one.change == "remove" and _removed_blocks(diagram, one) == taken),
        None,
    )


def _removed_blocks(before: Diagram, edit: Insertion | Convention) -> frozenset[str]:
    """Names of the blocks that an edit of a diagram takes away."""
    after = before if isinstance(edit, Convention) else edit.diagram
    return frozenset(one.name for one in before.instances) - {one.name for one in after.instances}


def _structure(dataset: Dataset, model: Model) -> str:
    return structure_hash(model.diagram, dataset.kinds)
