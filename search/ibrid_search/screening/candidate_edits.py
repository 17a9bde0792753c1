"""The candidate edits of a diagram: effects of the catalogue, other edit families, blocks and wires
anywhere.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product

from ibrid.errors import DiagramError
from ibrid.parts.catalogue import CATALOGUE, FAMILIES, insertions
from ibrid.parts.editing.edit import NotInVocabulary
from ibrid.parts.editing.practice import Effect, Insertion
from ibrid.parts.editing.view import views_of
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import shipped_names, textbook
from ibrid.study import Study


@dataclass(frozen=True, eq=False)
class CandidateEdit:
    """Hold an edited diagram.

    `diagram` : after the edit. `description` : what changes, in a line. `source` : the effect of
    the catalogue, the edit family or the library diagram that it comes from. `initial_values` : new
    free parameter -> values to start from. `usual` : False for a block or a wire anywhere.
    """

    diagram: Diagram
    description: str
    source: str
    initial_values: Mapping[str, tuple[float, ...]]
    usual: bool = True


def library_hashes(study: Study) -> frozenset[str]:
    """Return the structure hashes of the library diagrams that the vocabulary contains."""
    examinations = [study.examined(textbook(name), name) for name in shipped_names()]
    return frozenset(examination.hash for examination in examinations if examination.hash)


def list_exchange_edits(diagram: Diagram, study: Study) -> list[CandidateEdit]:
    """List what stands in a diagram exchanged for an effect that it is confused with.

    A part that stands in for another one explains most of what that one does, so that adding the
    right one beside it gains little, and taking it away loses much. Each structure once, without
    those that one edit leads to.
    """
    known_hashes = {study.hash_of(diagram)}
    known_hashes.update(study.hash_of(edit.diagram) for edit in list_effect_edits(diagram, study))
    exchanges: list[CandidateEdit] = []
    for removal, insertion in _exchanges(diagram, study):
        structure_hash = study.hash_of(insertion.diagram)
        if structure_hash not in known_hashes:
            known_hashes.add(structure_hash)
            removed = f"{removal.effect}: {removal.change} {removal.where}"
            inserted = f"{insertion.effect}: {insertion.change} {insertion.where}"
            exchanges.append(
                CandidateEdit(
                    insertion.diagram,
                    f"{removed}; {inserted}",
                    f"{removal.effect} + {insertion.effect}",
                    insertion.parameters,
                )
            )
    return exchanges


def _exchanges(diagram: Diagram, study: Study) -> Iterator[tuple[Insertion, Insertion]]:
    """Yield each removal of an effect with each insertion of one that it is confused with.

    Effect by effect, since two effects may take the same part away.
    """
    by_id = {effect.id: effect for effect in CATALOGUE if not effect.form}
    for effect in by_id.values():
        alike = tuple(by_id[name] for name in effect.confused_with if name in by_id)
        for removal in insertions(diagram, study.kinds, (effect,)):
            if removal.change != "remove":
                continue
            for insertion in insertions(removal.diagram, study.kinds, alike):
                if insertion.change != "remove":
                    yield removal, insertion


def unchanged(diagram: Diagram) -> CandidateEdit:
    """Return the diagram itself as a candidate, for a screening fit of what a removal leaves."""
    return CandidateEdit(diagram, "", "", {})


def list_effect_edits(diagram: Diagram, study: Study) -> list[CandidateEdit]:
    """List the insertions and removals of every effect of the catalogue.

    Without the forms of delays, which `list_delay_form_edits` lists.
    """
    return _insert_effects(diagram, study, (effect for effect in CATALOGUE if not effect.form))


def list_delay_form_edits(diagram: Diagram, study: Study) -> list[CandidateEdit]:
    """List the diagram with each other form of its delays (exact, hold, Pade).

    Empty for recordings alone, which do not show the form.
    """
    if study.events is not None:
        return []
    return _insert_effects(diagram, study, (effect for effect in CATALOGUE if effect.form))


def _insert_effects(
    diagram: Diagram, study: Study, effects: Iterable[Effect]
) -> list[CandidateEdit]:
    """Apply effects at every location of a diagram that they fit."""
    return [
        CandidateEdit(
            insertion.diagram,
            f"{insertion.effect}: {insertion.change} {insertion.where}",
            insertion.effect,
            insertion.parameters,
        )
        for insertion in insertions(diagram, study.kinds, tuple(effects))
    ]


def list_family_edits(diagram: Diagram, study: Study) -> list[CandidateEdit]:
    """List the edits of the usual edit families, each structure once, without the effects."""
    return [edit for edit in _edits_by_family(diagram, study) if edit.usual]


def list_arbitrary_edits(diagram: Diagram, study: Study) -> list[CandidateEdit]:
    """List every block or wire anywhere that gives a new structure."""
    return [edit for edit in _edits_by_family(diagram, study) if not edit.usual]


def list_layer_edits(diagram: Diagram, study: Study) -> list[CandidateEdit]:
    """List the edits that insert a missing control layer or replace the output filter.

    Empty if no layer is missing: details of a control structure are screened once it is complete.
    """
    missing_layers = _count_missing_layers(diagram, study)
    if not missing_layers:
        return []
    plants = _plant_kinds(diagram, study)
    edits = [*list_effect_edits(diagram, study), *list_family_edits(diagram, study)]
    return [
        edit
        for edit in edits
        if _count_missing_layers(edit.diagram, study) < missing_layers
        or _plant_kinds(edit.diagram, study) != plants
    ]


def _count_missing_layers(diagram: Diagram, study: Study) -> int:
    """Count the control layers that the devices of a diagram lack."""
    return sum(view.roles.missing_layers for view in views_of(diagram, study.kinds))


def _plant_kinds(diagram: Diagram, study: Study) -> list[str]:
    """Return the kinds of the output filters of a diagram, sorted."""
    return sorted(view.kind(view.roles.plant) for view in views_of(diagram, study.kinds))


def _edits_by_family(diagram: Diagram, study: Study) -> Iterator[CandidateEdit]:
    """Yield the edits of all edit families that give a new structure, usual families first."""
    effect_edits = list_effect_edits(diagram, study)
    known_hashes = {study.hash_of(diagram)}
    known_hashes.update(study.hash_of(edit.diagram) for edit in effect_edits)
    views = views_of(diagram, study.kinds)
    usual_first = sorted(FAMILIES, key=lambda family: not family.usual)
    for family, view in product(usual_first, views):
        for move in family.moves(view):
            try:
                edited = view.drawn(move.draw)
                structure_hash = study.hash_of(edited.diagram)
            except (NotInVocabulary, DiagramError):
                continue
            if structure_hash in known_hashes:
                continue
            known_hashes.add(structure_hash)
            initial_values = {name: strength.bank for name, strength in edited.strengths.items()}
            yield CandidateEdit(
                edited.diagram, view.words(move), family.name, initial_values, family.usual
            )
