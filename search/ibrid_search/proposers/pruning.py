"""What does not pay goes: proposals that take something away from a candidate or draw it more plainly, and add nothing."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import chain, combinations

import numpy as np

from ibrid.evaluation.record import Record
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.plant import L_FILTER, LCL
from ibrid.parts.blocks import removals, twin_removals
from ibrid.parts.edit import Edit
from ibrid.parts.inner_loops import loop_removals
from ibrid.parts.view import Move, View, views_of
from ibrid.parts.wiring import cut_wires, shared_parameters
from ibrid.signals import Signal
from ibrid.structure.diagram import Diagram
from ibrid.structure.wiring import split_port
from ibrid_search.proposal import Context, Proposal
from ibrid_search.proposers.edited import edited, proposal_of
from ibrid_search.proposers.plain_forms import plain_forms

#: Removals that are tried in pairs, once every single one was tried.
MOST_DOUBTFUL = 10
#: What a look may lose, in ln(error): a fit finds more than a look.
AFFORDABLE = 1.0


class Pruning:
    """Takes away a block, a loop, a wire or the freedom of a parameter; what the data do not see, and what is no part of a
    usual controller, first. `thorough` : what is drawn in a roundabout way is drawn plainly before that, and two things go at
    once after it. `loss` : in ln(error), of a diagram, from a look at the data; what loses least
    goes first, and what loses more than `AFFORDABLE` stays."""

    name = "pruning"
    attempts = 1
    window: int | None = None

    def __init__(self, *, thorough: bool = False, loss: Callable[[Context, Diagram], float] | None = None) -> None:
        self.thorough, self.loss = thorough, loss

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """The first removal that leads to a legal structure not met before; no edit when none is left."""
        views = views_of(context.parent.diagram, context.study.kinds)
        if not views:
            return Proposal("", failure=f"the pruning knows diagrams with an {LCL.name} or {L_FILTER.name}; add one")
        record = context.parent.record
        unseen = unseen_modules(record)
        edits = [(view, move) for view in views for move in removal_moves(view)]

        def doubt(edit: tuple[View, Move]) -> int:
            view, move = edit
            words = set(re.findall(r"\w+", move.note))
            return bool(words & unseen) + bool(words & unrecognised_modules(view))

        ranked = sorted((edits[index] for index in rng.permutation(len(edits))), key=doubt, reverse=True)
        if self.loss is not None:
            looked = [(self.loss(context, after), edit) for edit in ranked if context.is_new(after := edited(*edit))]
            ranked = [edit for loss, edit in sorted(looked, key=lambda pair: pair[0]) if loss < AFFORDABLE]
        for view, move in chain(_plain(views, record), ranked, _pairs(ranked, doubt)) if self.thorough else ranked:
            found = edited(view, move)
            if context.is_new(found):
                return proposal_of(view, move, found)
        return Proposal("", failure="everything that could be taken away has been tried")


def removal_moves(view: View) -> Iterator[Move]:
    """Every edit that takes something away."""
    return chain(removals(view), twin_removals(view), loop_removals(view), cut_wires(view), shared_parameters(view))


def _plain(views: Sequence[View], record: Record) -> Iterator[tuple[View, Move]]:
    return ((view, move) for view in views for move in plain_forms(view, record))


def _pairs(
    ranked: Sequence[tuple[View, Move]], doubt: Callable[[tuple[View, Move]], int]
) -> Iterator[tuple[View, Move]]:
    """Two removals of what is doubtful in one device at once, the most doubtful first."""
    doubted = [edit for edit in ranked if doubt(edit) > 0 or edit[1].note.startswith("no ")][:MOST_DOUBTFUL]
    return ((view, both_moves(one, other)) for (view, one), (same, other) in combinations(doubted, 2) if same is view)


def both_moves(one: Move, other: Move) -> Move:
    """Two removals at once: two blocks may make up for each other, so that neither can go alone."""

    def change(draft: Edit) -> None:
        one.draw(draft)
        with suppress(KeyError):  # the first may have taken along what the second would take
            other.draw(draft)

    return Move(f"{one.note}, {other.note}", change)


def unseen_modules(record: Record) -> set[str]:
    """Modules with a parameter at a bound of its box, or one that the data leave open."""
    names = {split_port(entry.split()[0])[0] for entry in record.at_bound}
    for intervals in record.intervals.values():
        names |= {split_port(name)[0] for name, interval in intervals.items() if interval is None}
    return names


def unrecognised_modules(view: View) -> set[str]:
    """Modules that are not of the layers an engineer expects: filters, gains and delays here and there."""
    roles = view.roles
    known = {roles.plant, roles.frequency, roles.current_loop, roles.voltage_loop, *roles.power, *roles.outer}
    return {name for name in view.draft.instances if name not in known and _doubtful(view.draft.kind(name))}


def _doubtful(kind: ModuleKind) -> bool:
    """True for what is easily put in and fits anything."""
    regulator = kind.element is Element.PI and kind.signal is Signal.DQ_VEC
    return kind.shapes or regulator or kind.element in (Element.GAIN, Element.COUPLING)
