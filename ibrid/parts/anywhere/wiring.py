"""Local edits: a sign, a wire, a measured signal, a shared parameter."""

from collections.abc import Iterator
from itertools import combinations

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit
from ibrid.parts.editing.practice import Family
from ibrid.parts.editing.view import Move, View, of_circuit
from ibrid.parts.inner_loops.current_measurement import OTHER_CURRENT, everywhere, rewired
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.reading.wiring import split_port


def _signs(view: View) -> Iterator[Move]:
    """The opposite sign on a wire that carries a feedback."""
    for source, target in view.wires:
        (name, port), owner = split_port(target), split_port(source)[0]
        if not name or port in ("v_in", "v_DQ", "i_dq", "delta", "delta_omega", "e", "i"):
            continue
        made = view.element(owner) if owner else None
        if view.element(name) is not Element.SIGN and made is not Element.ZERO:

            def turned(
                draft: Edit,
                source: str = source,
                target: str = target,
                signed: bool = made is Element.SIGN,
            ) -> None:
                draft.disconnect(source, target)
                opposite = (
                    draft.sources(f"{split_port(source)[0]}.in_")
                    if signed
                    else [draft.negated(source)]
                )
                draft.gather(target, *opposite)

            yield Move(f"the other sign at {target}", turned)


def _measurements(view: View) -> Iterator[Move]:
    """Another measured signal in a wire's place: grid or converter current, filter or terminal
    voltage, q for p.
    """
    roles, draft = view.roles, view.draft
    currents = [
        f"{roles.plant}.{port}"
        for port in ("i_ti", "i_g", "i_C")
        if port in draft.kind(roles.plant).outputs
    ]
    rotated = [f"{name}.v_dq" for name in draft.having(Element.ROTATION_IN)]
    voltages = [roles.voltage, *(rotated or [TERMINAL_VOLTAGE])]
    powers = [[f"{name}.p", f"{name}.q"] for name in roles.power]
    for group in (currents, voltages, *powers):
        for source, target in view.wires:
            for other in group if source in group and not of_circuit(draft, target) else []:
                if other != source:
                    yield rewired(
                        f"{other} instead of {source} at {target}", source, other, [target]
                    )
        for one, other in combinations(group, 2):
            yield from (everywhere(one, other), everywhere(other, one))


def cut_wires(view: View) -> Iterator[Move]:
    """One wire of a sum less."""
    for source, target in view.wires:
        if len(view.draft.sources(target)) > 1 and target != TERMINAL_CURRENT:
            yield Move(
                f"no {source} at {target}", lambda draft, s=source, t=target: draft.disconnect(s, t)
            )


def _injection_points(view: View) -> Iterator[Move]:
    """An injection point moved to another summing input of the controller."""
    draft, roles = view.draft, view.roles
    shapers = draft.having(Element.LOW_PASS, Element.DELAY, Element.PADE, signal=Signal.DQ_VEC)
    entries = (f"{name}.in_" for name in (roles.voltage_loop, *shapers) if name)
    points = [*dict.fromkeys((roles.command, roles.reference, *entries))]
    for source, target in view.wires:
        for point in points if target in points and draft.signal(source) is Signal.DQ_VEC else ():
            if point != target and split_port(point)[0] != split_port(source)[0]:

                def moved(
                    draft: Edit, source: str = source, target: str = target, point: str = point
                ) -> None:
                    draft.disconnect(source, target)
                    draft.connect(source, point)

                yield Move(f"{source} to {point} instead of {target}", moved)


def shared_parameters(view: View) -> Iterator[Move]:
    """Parameters of two blocks of a kind made one."""
    for block, other in _alike(view):
        if view.bound(block) != view.bound(other):
            yield Move(
                f"the same parameters for {block} and {other}",
                lambda draft, block=block, other=other: draft.bind(other, **view.bound(block)),
            )


def _freed_parameters(view: View) -> Iterator[Move]:
    """Parameters that two blocks share freed."""
    for pair in _alike(view):
        if view.bound(pair[0]) == view.bound(pair[1]):

            def freed(draft: Edit, pair: tuple[str, str] = pair) -> None:
                for name in pair:
                    draft.unbind(name, *draft.kind(name).parameters)

            yield Move(f"parameters of their own for {pair[0]} and {pair[1]}", freed)


def _alike(view: View) -> Iterator[tuple[str, str]]:
    """Pairs of blocks of one kind with parameters."""
    names = [name for name in view.draft.instances if view.draft.kind(name).parameters]
    return (
        (one, other) for one, other in combinations(names, 2) if view.kind(one) == view.kind(other)
    )


FAMILIES = (
    Family("sign", "local", (0.5, 0.5, 0.5, 0.5), 0.5, _signs, usual=False),
    Family("measured signal", "local", (0.3, 0.6, 1.0, 0.7), 0.8, _measurements, usual=False),
    *OTHER_CURRENT,
    Family("injection point", "local", (0.4, 0.6, 0.8, 0.5), 0.8, _injection_points, usual=False),
    Family("one wire less", "local", (0.4, 0.4, 0.4, 0.4), 0.4, cut_wires, usual=False),
    Family("shared parameters", "local", (0.5, 0.5, 0.5, 0.5), 0.3, shared_parameters, usual=False),
    Family("freed parameters", "local", (0.5, 0.5, 0.5, 0.5), 0.3, _freed_parameters),
)
