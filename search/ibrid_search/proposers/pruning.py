"""What does not pay goes: proposals that take something away from a candidate or draw it more
plainly, and add nothing.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import chain, combinations

import numpy as np

from ibrid.evaluation.record import Record
from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.plant import L_FILTER, LCL
from ibrid.parts.anywhere.blocks import removals, twin_removals
from ibrid.parts.anywhere.wiring import cut_wires, shared_parameters
from ibrid.parts.editing.edit import Edit
from ibrid.parts.editing.view import Move, View, views_of
from ibrid.parts.inner_loops.current_voltage_loops import loop_removals
from ibrid.parts.plant.output_filter import OF_THE_FILTER
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.wiring import split_port
from ibrid_search.proposal import Context, Proposal, Proposer

#: Removals that are tried in pairs, once every single one was tried.
MOST_DOUBTFUL = 10
#: What a look may lose, in free numbers or in ln(error): a fit finds more than a look.
AFFORDABLE = 1.0


class Pruning(Proposer):
    """Takes away a block, a loop, a wire or the freedom of a parameter; what the data do not see,
    and what is no part of a usual controller, first. `thorough` : what is drawn in a roundabout way
    is drawn plainly before that, and two things go at once after it. `loss` : of a diagram, from a
    look at the data; what loses least goes first, and what loses more than `AFFORDABLE` stays.
    """

    name = "pruning"

    def __init__(
        self, *, thorough: bool = False, loss: Callable[[Context, Diagram], float] | None = None
    ) -> None:
        self.thorough, self.loss = thorough, loss

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """The first removal that leads to a legal structure not met before; no edit when none is
        left.
        """
        views = views_of(context.parent.diagram, context.study.kinds)
        if not views:
            return Proposal(
                "",
                failure=f"the pruning knows diagrams with an {LCL.name} or {L_FILTER.name}; add "
                "one",
            )
        record = context.parent.record
        unseen = unseen_modules(record)
        edits = [(view, move) for view in views for move in removal_moves(view)]

        def doubt(edit: tuple[View, Move]) -> int:
            view, move = edit
            words = set(re.findall(r"\w+", move.note))
            return bool(words & unseen) + bool(words & unrecognised_modules(view))

        ranked = sorted(
            (edits[index] for index in rng.permutation(len(edits))), key=doubt, reverse=True
        )
        if self.loss is not None:
            looked = [
                (self.loss(context, after), (view, move))
                for view, move in ranked
                if context.is_new(after := view.after(move))
            ]
            ranked = [
                edit for loss, edit in sorted(looked, key=lambda pair: pair[0]) if loss < AFFORDABLE
            ]
        plain = (
            (view, move) for view in views for move in chain(_wires(view, record), _plls(view))
        )
        for view, move in chain(plain, ranked, _pairs(ranked, doubt)) if self.thorough else ranked:
            found = view.after(move)
            if context.is_new(found):
                return Proposal.between(view.whole, found, view.words(move))
        return Proposal("", failure="everything that could be taken away has been tried")


def removal_moves(view: View) -> Iterator[Move]:
    """Every edit that takes something away."""
    less = (
        (effect.id, move)
        for effect in OF_THE_FILTER
        for move in effect.moves(view)
        if move.change == "remove"
    )
    of_filter = (replace(move, note=f"{name}: remove {move.where}") for name, move in less)
    blocks = chain(removals(view), twin_removals(view), loop_removals(view))
    return chain(blocks, of_filter, cut_wires(view), shared_parameters(view))


def _pairs(
    ranked: Sequence[tuple[View, Move]], doubt: Callable[[tuple[View, Move]], int]
) -> Iterator[tuple[View, Move]]:
    """Two removals of what is doubtful in one device at once, the most doubtful first."""
    doubted = [edit for edit in ranked if doubt(edit) > 0 or edit[1].note.startswith("no ")][
        :MOST_DOUBTFUL
    ]
    return (
        (view, both_moves(one, other))
        for (view, one), (same, other) in combinations(doubted, 2)
        if same is view
    )


def both_moves(first: Move, other: Move) -> Move:
    """Two removals at once: two blocks may make up for each other, so that neither can go alone."""

    def change(draft: Edit) -> None:
        first.draw(draft)
        with suppress(KeyError):  # the first may have taken along what the second would take
            other.draw(draft)

    return Move(f"{first.note}, {other.note}", change)


def unseen_modules(record: Record) -> set[str]:
    """Modules with a parameter at a bound of its box, or one that the data leave open."""
    names = {split_port(entry.split()[0])[0] for entry in record.at_bound}
    for intervals in record.intervals.values():
        names |= {split_port(name)[0] for name, interval in intervals.items() if interval is None}
    return names


def unrecognised_modules(view: View) -> set[str]:
    """Modules that are not of the layers an engineer expects: filters, gains and delays here and
    there.
    """
    roles = view.roles
    known = {
        roles.plant,
        roles.frequency,
        roles.current_loop,
        roles.voltage_loop,
        *roles.power,
        *roles.outer,
    }
    return {
        name
        for name in view.draft.instances
        if name not in known and _doubtful(view.draft.kind(name))
    }


def _doubtful(kind: ModuleKind) -> bool:
    """True for what is easily put in and fits anything."""
    regulator = kind.element is Element.PI and kind.signal is Signal.DQ_VEC
    return kind.shapes or regulator or kind.element in (Element.GAIN, Element.COUPLING)


#: A gain this near to 1 or -1 is a wire.
UNITY = 0.02


def _wires(view: View, record: Record) -> Iterator[Move]:
    """Free gains that were fitted to 1 or -1 as what they are, a wire or a sign; the fit tells
    whether it is the same.
    """
    for name in view.draft.having(Element.GAIN):
        (gain,) = view.draft.kind(name).parameters
        shared = view.draft.instances[name].bindings.get(gain)
        sign = _unit(shared if isinstance(shared, str) else f"{name}.{gain}", record)
        if sign > 0:
            yield Move(f"{name} is 1, a wire", lambda draft, name=name: draft.bypass(name))
        elif sign < 0:
            yield Move(f"{name} is -1, a sign", lambda draft, name=name: _negate(draft, name))


def _negate(draft: Edit, name: str) -> None:
    draft.replace(name, draft.usual(Element.SIGN, draft.kind(name).signal), f"minus_{name}")


def _unit(parameter: str, record: Record) -> int:
    """1 or -1 for a free parameter that has this value at all operating points, within `UNITY` or
    an interval that tells its sign; else 0.
    """

    def near(op: str, sign: int) -> bool:
        value, interval = (
            record.parameters[op].get(parameter),
            record.intervals.get(op, {}).get(parameter),
        )
        if value is None:
            return False
        if abs(value - sign) <= UNITY:
            return True
        return (
            interval is not None
            and interval[0] * interval[1] > 0
            and interval[0] <= sign <= interval[1]
        )

    return next(
        (
            sign
            for sign in (1, -1)
            if record.parameters and all(near(op, sign) for op in record.parameters)
        ),
        0,
    )


def _plls(view: View) -> Iterator[Move]:
    """A frequency meter in the frame that it turns itself, with the integrator that makes the
    angle, as a PLL.

    Both are the same where the voltage that it sees is on the d axis at rest.
    """
    draft = view.draft
    for meter in (
        draft.having(Element.FREQUENCY_METER) if view.known(draft.usual(Element.PLL)) else ()
    ):
        frequency = f"{meter}.delta_omega_pll"
        angles = [
            split_port(one)[0]
            for one in draft.targets(frequency)
            if draft.sources(one) == [frequency]
        ]
        angles = [
            name for name in angles if name and draft.kind(name).element is Element.INTEGRATOR
        ]
        if angles and draft.sources(f"{meter}.delta_omega") == [frequency]:
            words = f"{meter} turns its own frame, a PLL"
            yield Move(
                words, partial(_as_pll, plant=view.roles.plant, meter=meter, angle=angles[0])
            )


def _as_pll(draft: Edit, *, plant: str, meter: str, angle: str) -> None:
    pll = draft.add(draft.usual(Element.PLL), "pll", **draft.instances[meter].bindings)
    for source in draft.sources(f"{meter}.v"):
        q_axis = (
            f"{plant}.e_q"
            if source == f"{plant}.e"
            else draft.after(source, draft.usual(Element.SLICE_Q), "q_axis")
        )
        draft.connect(q_axis, f"{pll}.e_q")
    others = (
        one
        for one in draft.targets(f"{meter}.delta_omega_pll")
        if split_port(one)[0] not in (meter, angle)
    )
    draft.connect(f"{pll}.delta_omega", *others)
    draft.connect(f"{pll}.delta", *draft.targets(f"{angle}.out"))
    draft.remove(meter, angle)
