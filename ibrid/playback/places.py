"""Where limits and freezes act in a diagram: found by role, so that any legal diagram with a
current controller has them.
"""

from dataclasses import dataclass

from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.paths import (
    command_entry,
    current_path,
    measured_current,
    odd_signs,
    packs,
    path,
)
from ibrid.parts.editing.view import View, view_of
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import Diagram


@dataclass(frozen=True)
class Regulator:
    """A regulator with an integrator that drives one axis of the current reference, or both (a dq
    kind, `axis` None).

    `sign` : of the way from its output to the reference.
    """

    name: str
    axis: int | None
    sign: int


@dataclass(frozen=True)
class Places:
    """`voltage` : port of the voltage at the filter, whose magnitude protections look at.

    `reference` : input of the current controller, None without one; `measured` : its source that is
    the measured current. `outer` : regulators that drive the rest of that sum. `current_loop` : its
    instance. `command` : the input at which the whole command adds up, before delays. `pll` : input
    of the PLL, None without one.
    """

    voltage: str
    reference: str | None
    measured: str
    outer: tuple[Regulator, ...]
    current_loop: str | None
    command: str
    pll: str | None


def places_of(diagram: Diagram, kinds: Vocabulary) -> Places | None:
    """The places of a legal diagram with one device; None where its roles cannot be told."""
    view = view_of(diagram, kinds)
    if view is None or not view.alone:
        return None
    draft, roles, way = view.draft, view.roles, current_path(view)
    loop = roles.current_loop if way else None
    plls = draft.having(Element.PLL)
    return Places(
        voltage=roles.voltage,
        reference=None if loop is None else f"{loop}.in_",
        measured=""
        if loop is None
        else (f"{way[-2]}.out" if len(way) > 1 else measured_current(view)),
        outer=() if loop is None else tuple(_outer(view)),
        current_loop=loop,
        command=command_entry(draft, view),
        pll=f"{plls[0]}.e_q" if plls else None,
    )


def _outer(view: View) -> list[Regulator]:
    draft, regulators = view.draft, []
    integrating = (Element.PI, Element.INTEGRATOR)
    inputs = {f"{pack}.in_{'dq'[axis]}": axis for pack in packs(view) for axis in (0, 1)}
    for name in draft.having(*integrating, signal=Signal.SCALAR):
        for target, axis in inputs.items():
            way = path(draft, f"{name}.out", target)
            if way is not None:
                regulators.append(Regulator(name, axis, _sign(view, way)))
    for name in draft.having(*integrating, signal=Signal.DQ_VEC):
        way = (
            None
            if name == view.roles.current_loop
            else path(draft, f"{name}.out", view.roles.reference)
        )
        if way is not None:
            regulators.append(Regulator(name, None, _sign(view, way)))
    return regulators


def _sign(view: View, way: tuple[str, ...]) -> int:
    return -1 if odd_signs(view, way) else 1
