"""Removal of one edit from a repaired model: the others are applied without it, and refitted."""

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
    """Remove forms of delays that a later edit made irrelevant, where the structure stays the same.

    The later edit is then reported as one of the given model.
    """
    for position in reversed(find_lost_forms(given.diagram, best.edits)):
        remainder = refit_without_edit(dataset, given, best, position)
        if remainder is None:
            continue
        if _structure(dataset, remainder) == _structure(dataset, best):
            best = remainder
    return best


def refit_without_edit(dataset: Dataset, given: Model, best: Model, position: int) -> Model | None:
    """Refit the repaired model without the edit at a position.

    None where the others cannot be applied without it, or without a response.
    """
    model = given
    applied: tuple[Insertion | Convention, ...] = ()
    diagram_before = given.diagram
    for number, edit in enumerate(best.edits):
        removed = _removed_blocks(diagram_before, edit)
        if isinstance(edit, Insertion):
            diagram_before = edit.diagram
        if number == position:
            continue
        if isinstance(edit, Convention):
            model = replace(model, convention=edit, extra=best.extra)
            applied = (*applied, edit)
            continue
        same = _find_same_edit(dataset.insertions(model), model.diagram, edit, removed)
        if same is None:
            return None
        model = replace(model, diagram=same.diagram)
        applied = (*applied, same)
    model = replace(model, edits=applied)
    return dataset.refit_model(model, [best.refit.values, {}], draws=TRIAL_DRAWS)


def _find_same_edit(
    edits: Sequence[Insertion], diagram: Diagram, edit: Insertion, removed: frozenset[str]
) -> Insertion | None:
    """Find the edit of a diagram that does what an edit did to another one; None where none does.

    By its name, or by the blocks that it removes.
    """
    name = (edit.effect, edit.change, edit.where)
    for candidate in edits:
        if (candidate.effect, candidate.change, candidate.where) == name:
            return candidate
    if edit.change != "remove" or not removed:
        return None
    for candidate in edits:
        if candidate.change == "remove" and _removed_blocks(diagram, candidate) == removed:
            return candidate
    return None


def _removed_blocks(before: Diagram, edit: Insertion | Convention) -> frozenset[str]:
    """Return the names of the blocks that an edit of a diagram removes."""
    after = before if isinstance(edit, Convention) else edit.diagram
    names_after = {block.name for block in after.instances}
    return frozenset(block.name for block in before.instances) - names_after


def _structure(dataset: Dataset, model: Model) -> str:
    """Return the structure hash of a model's diagram."""
    return structure_hash(model.diagram, dataset.kinds)
