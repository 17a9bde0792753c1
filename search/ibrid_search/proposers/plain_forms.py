"""Roundabout drawings of simple things, as what they are: a gain of 1 is a wire, one of -1 a sign, a frequency meter that
turns its own frame a PLL."""

from collections.abc import Iterator
from functools import partial
from itertools import chain

from ibrid.evaluation.record import Record
from ibrid.modules.behaviour import Element
from ibrid.parts.edit import Edit
from ibrid.parts.view import Move, View
from ibrid.structure.wiring import split_port

#: A gain this near to 1 or -1 is a wire.
UNITY = 0.02


def plain_forms(view: View, record: Record) -> Iterator[Move]:
    """Every edit that draws the same thing more plainly; the fit tells whether it is the same."""
    return chain(_wires(view, record), _plls(view))


def _wires(view: View, record: Record) -> Iterator[Move]:
    """Free gains that were fitted to 1 or -1 as what they are, a wire or a sign."""
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
    """1 or -1 for a free parameter that has this value at all operating points, within `UNITY` or an interval that tells
    its sign; else 0."""

    def near(op: str, sign: int) -> bool:
        value, interval = record.parameters[op].get(parameter), record.intervals.get(op, {}).get(parameter)
        if value is None:
            return False
        if abs(value - sign) <= UNITY:
            return True
        return interval is not None and interval[0] * interval[1] > 0 and interval[0] <= sign <= interval[1]

    return next((sign for sign in (1, -1) if record.parameters and all(near(op, sign) for op in record.parameters)), 0)


def _plls(view: View) -> Iterator[Move]:
    """A frequency meter in the frame that it turns itself, with the integrator that makes the angle, as a PLL.

    Both are the same where the voltage that it sees is on the d axis at rest.
    """
    draft = view.draft
    for meter in draft.having(Element.FREQUENCY_METER) if view.known(draft.usual(Element.PLL)) else ():
        frequency = f"{meter}.delta_omega_pll"
        angles = [split_port(one)[0] for one in draft.targets(frequency) if draft.sources(one) == [frequency]]
        angles = [name for name in angles if name and draft.kind(name).element is Element.INTEGRATOR]
        if angles and draft.sources(f"{meter}.delta_omega") == [frequency]:
            words = f"{meter} turns its own frame, a PLL"
            yield Move(words, partial(_as_pll, plant=view.roles.plant, meter=meter, angle=angles[0]))


def _as_pll(draft: Edit, *, plant: str, meter: str, angle: str) -> None:
    pll = draft.add(draft.usual(Element.PLL), "pll", **draft.instances[meter].bindings)
    for source in draft.sources(f"{meter}.v"):
        q_axis = (
            f"{plant}.e_q" if source == f"{plant}.e" else draft.after(source, draft.usual(Element.SLICE_Q), "q_axis")
        )
        draft.connect(q_axis, f"{pll}.e_q")
    for target in draft.targets(f"{meter}.delta_omega_pll"):
        if split_port(target)[0] not in (meter, angle):
            draft.connect(f"{pll}.delta_omega", target)
    for target in draft.targets(f"{angle}.out"):
        draft.connect(f"{pll}.delta", target)
    draft.remove(meter)
    draft.remove(angle)
