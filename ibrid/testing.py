"""Contract tests for authors of kinds, effects and proposers; what ships is held to the same.

    def test_my_kind():
        ibrid.testing.check_kind(MINE)

Each raises one AssertionError that lists everything to mend.
"""

import math
import pickle
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ibrid.border import takes_kinds
from ibrid.evaluation.evaluate import record_at
from ibrid.lazy import imported_by_need
from ibrid.measurement.read import read_sweep
from ibrid.modules.contract import complaints_about, require_no_complaints
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY, Vocabulary
from ibrid.parts.catalogue import insertions
from ibrid.parts.editing.practice import Effect, Insertion
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook, textbook_names
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

if TYPE_CHECKING:  # the same names for type checkers, which a test compares
    from ibrid_search.testing import check_proposer

__all__ = ["check_effect", "check_kind", "check_proposer"]

#: Public name -> the module that it is imported from when it is first used.
HOMES = {
    "check_proposer": "ibrid_search.testing",
}

if not TYPE_CHECKING:  # with it every misspelt name would have the type Any
    __getattr__ = imported_by_need(__name__, HOMES)

#: An edit with all new parameters at their `nothing` is the given model to this, relative to the
#: largest entry.
SAME = 1e-6


@takes_kinds
def check_kind(
    kind: ModuleKind, rng: np.random.Generator | None = None, *, points: int = 10
) -> None:
    """Check that a kind works as those that ship do.

    At random parameters and operating points its law gives the same matrices for floats and CasADi
    symbols, every argument of `state_space` changes the response, every state is moved by the
    inputs and seen by the outputs, and a large-signal law linearises to the state space. It travels
    to another process.

    Parameters
    ----------
    kind : one's own. rng : for the draws; by default the same ones every time. points : number of
    draws.

    Raises
    ------
    AssertionError : a list of what to mend.
    """
    require_no_complaints(
        f"the kind {kind.name}", (*complaints_about(kind, rng, points=points), *_travels(kind))
    )


@takes_kinds
def check_effect(
    effect: Effect,
    diagrams: Sequence[Diagram] = (),
    vocabulary: Vocabulary = VOCABULARY,
    *,
    measured: str = "paper_like",
) -> None:
    """Check that an effect edits diagrams as those of the catalogue do.

    Of given diagrams, by default the textbook ones, at least one has an insertion. Each insertion
    is legal and another structure than the given one, names its new free parameters with a bank of
    strengths within their boxes, and is the given model when they are at their `nothing`. Asked
    again the effect answers the same. It travels to another process.

    Parameters
    ----------
    effect : one's own. diagrams : legal, with a plant. vocabulary : kinds that edits may use.
    measured : the shipped
        sweep at whose operating points models are compared.

    Raises
    ------
    AssertionError : a list of what to mend.
    """
    given = tuple(diagrams) or tuple(textbook(name) for name in textbook_names())
    complaints = [
        f"{word} must say what it is in words, found {value!r}; results and pages show it"
        for word in ("id", "law", "places", "signature", "told_apart_by")
        if not (isinstance(value := getattr(effect, word), str) and value.strip())
    ]
    if effect.id in effect.confused_with:
        complaints.append(f"confused_with must name other effects, found {effect.id} itself")
    complaints += _travels(effect)
    number = 0
    for diagram in given:
        try:
            first, again = (insertions(diagram, vocabulary, (effect,)) for _ in range(2))
        except Exception as error:  # other people's code: anything may go wrong in it
            complaints.append(
                f"moves must not raise, found {type(error).__name__} ({error}) for {diagram.name}"
            )
            continue
        if first != again:
            complaints.append(
                f"moves must be the same each time, found others for {diagram.name}; use no chance"
            )
        number += len(first)
        for insertion in first:
            complaints += _of_insertion(diagram, insertion, vocabulary, measured)
    if (number == 0) != effect.measurement:
        complaints.append(
            "moves must change at least one of the diagrams, found none; give `diagrams` that it "
            "applies to"
            if number == 0
            else f"an effect of the measurement edits no diagram, found {number} insertions; leave "
            "measurement False"
        )
    require_no_complaints(f"the effect {effect.id}", complaints)


def _travels(value: ModuleKind | Effect) -> tuple[str, ...]:
    law = value.state_space if isinstance(value, ModuleKind) else value.moves
    if law.__module__ == "__main__":  # written in a notebook, whose functions Ray carries along
        return ()
    try:
        same = pickle.loads(pickle.dumps(value)) == value
    except Exception as error:  # whatever pickle meets in other people's values
        return (
            f"it must travel to another process, found {error}; name its functions at the top of a "
            "module, no lambda",
        )
    return (
        ()
        if same
        else ("it must be the same after a trip to another process; use frozen values alone",)
    )


def _of_insertion(
    given: Diagram, insertion: Insertion, kinds: Vocabulary, measured: str
) -> Iterator[str]:
    where = f"{insertion.change} {insertion.where} of {given.name}"
    if insertion.change not in ("add", "remove", "replace"):
        yield f"{where}: change must be add, remove or replace, found {insertion.change}"
    before = {entry.name for entry in parameter_table(wire(given, kinds), "exact").free}
    free = {
        entry.name: entry for entry in parameter_table(wire(insertion.diagram, kinds), "exact").free
    }
    if undeclared := free.keys() - before - insertion.parameters.keys():
        yield (
            f"{where}: every new free parameter needs a Strength, found none for "
            f"{', '.join(sorted(undeclared))}"
        )
    if len({len(bank) for bank in insertion.parameters.values()}) > 1:
        yield (
            f"{where}: the banks of one insertion have one length, their j-th numbers belong "
            "together"
        )
    for name, bank in insertion.parameters.items():
        box = free[name]
        if not bank or not all(
            math.isfinite(value) and box.low <= value <= box.high for value in bank
        ):
            yield (
                f"{where}: the bank of {name} must have values within [{box.low:g}, {box.high:g}], "
                f"found {bank}"
            )
    if unknown := insertion.nothing.keys() - insertion.parameters.keys():
        yield (
            f"{where}: `nothing` gives values of new parameters, {', '.join(sorted(unknown))} is "
            "none"
        )
    elif insertion.nothing and (far := _distance(given, insertion, kinds, measured)) > SAME:
        yield (
            f"{where}: with the parameters at `nothing` the model must be the given one, it "
            f"differs by {far:.1e}"
        )


def _distance(given: Diagram, insertion: Insertion, kinds: Vocabulary, measured: str) -> float:
    """Largest difference of the responses, relative to the given one's largest entry, at typical
    values.
    """
    sweep = read_sweep(benchmarks()[measured])
    op, frequency = sweep.names[0], sweep.points[0].frequency
    strengths = {name: bank[0] for name, bank in insertion.parameters.items()} | dict(
        insertion.nothing
    )
    typical = {
        entry.name: entry.typical for entry in parameter_table(wire(given, kinds), "exact").free
    }
    values = {
        entry.name: entry.typical
        for entry in parameter_table(wire(insertion.diagram, kinds), "exact").free
    }
    values |= {name: value for name, value in (typical | strengths).items() if name in values}
    before = record_at(given, sweep, typical, vocabulary=kinds).response(op, frequency)
    edited = record_at(insertion.diagram, sweep, values, vocabulary=kinds)
    known = {name: {**given_there, **strengths} for name, given_there in edited.parameters.items()}
    after = replace(edited, parameters=known).response(
        op, frequency
    )  # `nothing` may lie outside the box
    return float(np.abs(after - before).max() / np.abs(before).max())
