"""Local edits: a sign, a wire, a measured signal, a shared parameter."""

from collections.abc import Iterator
from itertools import combinations

from ibrid.signals import Signal
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port
from ibrid_search.proposers.moves.command import of_circuit
from ibrid_search.proposers.moves.family import Family, Move, View


def _signs(view: View) -> Iterator[Move]:
    """The opposite sign on a wire that carries a feedback."""
    for source, target in view.wires:
        name, port = split_port(target)
        kind = view.draft.instances[name].kind if name else ""
        owner = split_port(source)[0]
        if not name or port in ("v_in", "v_DQ", "i_dq", "delta", "delta_omega", "e", "i") or kind.startswith("Negate"):
            continue
        if owner and view.draft.instances[owner].kind.startswith("ConstZero"):
            continue
        if owner and view.draft.instances[owner].kind.startswith("Negate"):
            yield Move(f"the other sign at {target}", _straight(source, target))
        else:
            yield Move(f"the other sign at {target}", _turned(source, target))


def _straight(source: str, target: str):
    def change(draft: Draft) -> None:
        for before in draft.sources(f"{split_port(source)[0]}.in_"):
            draft.connect(before, target)
        draft.disconnect(source, target)

    return change


def _turned(source: str, target: str):
    def change(draft: Draft) -> None:
        draft.disconnect(source, target)
        draft.connect(draft.negated(source), target)

    return change


def _measurements(view: View) -> Iterator[Move]:
    """Another measured signal in a wire's place: grid or converter current, filter or terminal voltage, q for p."""
    roles, draft = view.roles, view.draft
    currents = [f"{roles.plant}.{port}" for port in ("i_ti", "i_g", "i_C") if port in draft.kind(roles.plant).outputs]
    rotated = [f"{name}.v_dq" for name in draft.named("Rot_v")]
    voltages = [roles.voltage, *(rotated or [TERMINAL_VOLTAGE])]
    powers = [[f"{name}.p", f"{name}.q"] for name in roles.power]
    groups = [group for group in (currents, voltages, *powers) if len(group) > 1]
    for group in groups:
        for source, target in view.wires:
            fixed = of_circuit(draft, target)
            for other in group if source in group and not fixed else []:
                if other != source:
                    yield Move(f"{other} instead of {source} at {target}", _rewired(source, other, target))
        for one, other in combinations(group, 2):
            for a, b in ((one, other), (other, one)):
                yield Move(f"{b} instead of {a} in the whole controller", _everywhere(a, b))


def _other_current(view: View) -> Iterator[Move]:
    """The current loop measures the other one of converter and grid current; alone, or the whole controller does."""
    roles, draft = view.roles, view.draft
    if roles.current_loop is None or not roles.lcl:
        return
    both = (f"{roles.plant}.i_ti", f"{roles.plant}.i_g")
    for one, other in (both, both[::-1]):
        for target in draft.targets(one):
            name, port = split_port(target)
            if name and draft.instances[name].kind in ("Negate_dq", "LPF1_dq") and port == "in_":
                yield Move(f"{other} instead of {one} at {target}", _rewired(one, other, target))
        yield Move(f"{other} instead of {one} in the whole controller", _everywhere(one, other))


def _rewired(source: str, other: str, target: str):
    def change(draft: Draft) -> None:
        draft.disconnect(source, target)
        draft.connect(other, target)

    return change


def _everywhere(source: str, other: str):
    def change(draft: Draft) -> None:
        for target in draft.targets(source):
            if not of_circuit(draft, target) and draft.instances[split_port(target)[0]].kind != "PQ_calc":
                _rewired(source, other, target)(draft)

    return change


def cut_wires(view: View) -> Iterator[Move]:
    """One wire of a sum less."""
    for source, target in view.wires:
        if len(view.draft.sources(target)) > 1 and target != TERMINAL_CURRENT:
            yield Move(f"no {source} at {target}", lambda d, s=source, t=target: d.disconnect(s, t))


def _injection_points(view: View) -> Iterator[Move]:
    """An injection point moved to another summing input of the controller."""
    draft, roles = view.draft, view.roles
    points = [roles.command, roles.reference]
    points += [f"{name}.in_" for name in (roles.voltage_loop,) if name]
    points += [f"{name}.in_" for name in draft.named("Delay", "Pade1_dq", "LPF1_dq")]
    for source, target in view.wires:
        if target in points and draft.signal(source) is Signal.DQ_VEC:
            for point in dict.fromkeys(points):
                if point != target and split_port(point)[0] != split_port(source)[0]:
                    yield Move(f"{source} to {point} instead of {target}", _moved(source, target, point))


def _moved(source: str, target: str, point: str):
    def change(draft: Draft) -> None:
        draft.disconnect(source, target)
        draft.connect(source, point)

    return change


def shared_parameters(view: View) -> Iterator[Move]:
    """Parameters of two blocks of a kind made one."""
    for one, other, keys in _alike(view):
        if not _same(view, one, other, keys):
            yield Move(f"the same parameters for {one} and {other}", _shared(one, other, keys))


def _freed_parameters(view: View) -> Iterator[Move]:
    """Parameters that two blocks share freed."""
    for one, other, keys in _alike(view):
        if _same(view, one, other, keys):
            yield Move(f"parameters of their own for {one} and {other}", _freed(one, other, keys))


def _alike(view: View) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Pairs of blocks of one kind with parameters, and the names of these."""
    names = [name for name in view.draft.instances if view.draft.kind(name).parameters]
    for one, other in combinations(names, 2):
        if view.draft.instances[one].kind == view.draft.instances[other].kind:
            yield one, other, tuple(view.draft.kind(one).parameters)


def _same(view: View, one: str, other: str, keys: tuple[str, ...]) -> bool:
    a, b = (view.draft.instances[name].bindings for name in (one, other))
    return all(a.get(key, f"{one}.{key}") == b.get(key, f"{other}.{key}") for key in keys)


def _freed(one: str, other: str, keys: tuple[str, ...]):
    def change(draft: Draft) -> None:
        draft.unbind(one, *keys)
        draft.unbind(other, *keys)

    return change


def _shared(one: str, other: str, keys: tuple[str, ...]):
    def change(draft: Draft) -> None:
        lent = {key: draft.instances[one].bindings.get(key, f"{one}.{key}") for key in keys}
        draft.bind(other, **lent)

    return change


WIRING = (
    Family("sign", "local", (0.5, 0.5, 0.5, 0.5), 0.5, _signs),
    Family("measured signal", "local", (0.3, 0.6, 1.0, 0.7), 0.8, _measurements),
    Family("other current", "local", (0.3, 0.6, 1.0, 0.7), 3.0, _other_current),
    Family("injection point", "local", (0.4, 0.6, 0.8, 0.5), 0.8, _injection_points),
    Family("one wire less", "local", (0.4, 0.4, 0.4, 0.4), 0.4, cut_wires),
    Family("shared parameters", "local", (0.5, 0.5, 0.5, 0.5), 0.3, shared_parameters),
    Family("freed parameters", "local", (0.5, 0.5, 0.5, 0.5), 0.3, _freed_parameters),
)
