"""Paths added to a controller: feedforward, decoupling of current and voltage, a droop of the frequency."""

from collections.abc import Iterator

from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port
from ibrid_search.proposers.moves.drawing import frequency_sources, summing
from ibrid_search.proposers.moves.family import Move, View


def feedforward(view: View) -> Iterator[Move]:
    """The measured voltage added to the command, as it is, scaled or filtered."""
    roles = view.roles
    if roles.command not in view.draft.targets(roles.voltage):
        yield Move("voltage feedforward", lambda draft: draft.connect(roles.voltage, summing(draft, roles.command)))
    for kind, words in (("Gain_dq", "scaled "), ("LPF1_dq", "filtered ")):
        if view.known(kind):

            def path(draft: Draft, kind: str = kind) -> None:
                draft.disconnect(roles.voltage, roles.command)
                name = draft.add(kind, "feedforward")
                draft.chain(roles.voltage, f"{name}.in_", f"{name}.out", summing(draft, roles.command))

            yield Move(f"{words}voltage feedforward", path)


def fed_forward(view: View) -> bool:
    """True when the measured voltage reaches the command without passing a regulator."""
    seen, waiting = set(), [view.roles.voltage]
    while waiting:
        port = waiting.pop()
        for target in view.draft.targets(port):
            name = split_port(target)[0]
            if target == view.roles.command:
                return True
            if (
                name
                and name not in seen
                and view.draft.instances[name].kind in ("LPF1_dq", "Gain_dq", "Pade1_dq", "Delay")
            ):
                seen.add(name)
                waiting.append(f"{name}.out")
    return False


def decoupling(view: View) -> Iterator[Move]:
    """The cross-coupling of the filter inductance cancelled, with the nominal or the synchronisation's frequency."""
    yield from _decouplings(view, view.roles.current, view.roles.command, "current")


def voltage_decoupling(view: View) -> Iterator[Move]:
    """The current of the filter's capacitor that the voltage loop needs, with the nominal or the synchronisation's
    frequency."""
    if view.roles.voltage_loop is not None:
        yield from _decouplings(view, view.roles.voltage, view.roles.reference, "voltage")


def _decouplings(view: View, port: str, target: str, words: str) -> Iterator[Move]:
    for kind in view.known("JMul", "JMul_omega"):
        if kind == "JMul_omega" and view.roles.frequency is None:
            continue

        def path(draft: Draft, kind: str = kind) -> None:
            add_crossing(draft, view, kind, port, "decoupling" if words == "current" else "voltage_decoupling", target)

        frequency = "the measured frequency" if kind == "JMul_omega" else "the nominal frequency"
        yield Move(f"decoupling of the {words} with {frequency}", path)


def add_crossing(draft: Draft, view: View, kind: str, port: str, stem: str, target: str | None = None) -> str:
    """A JMul or JMul_omega behind a port, with the frequency of the frame, that joins at `target`; returns its output."""
    name = draft.add(kind, stem)
    draft.connect(port, f"{name}.in_")
    for source in frequency_sources(draft, view.roles) if kind == "JMul_omega" else ():
        draft.connect(source, f"{name}.delta_omega")
    if target is not None:
        draft.connect(f"{name}.out", summing(draft, target))
    return f"{name}.out"


def decoupled(view: View) -> bool:
    """True when a cross-coupling is there that is neither of the voltage nor a virtual reactance."""
    others = {*_voltage_crossings(view), *virtual_reactances(view)}
    return any(name not in others for name in view.draft.named("JMul", "JMul_omega"))


def voltage_decoupled(view: View) -> bool:
    """True when the filter's voltage has a cross-coupling."""
    return bool(_voltage_crossings(view))


def _voltage_crossings(view: View) -> list[str]:
    crossings = view.draft.named("JMul", "JMul_omega")
    return [name for name in crossings if view.roles.voltage in view.draft.sources(f"{name}.in_")]


def virtual_reactances(view: View) -> list[str]:
    """Cross-couplings that act on the voltage loop's reference."""
    draft, loop = view.draft, view.roles.voltage_loop
    found = []
    for name in draft.named("JMul", "JMul_omega") if loop else ():
        ends = draft.targets(f"{name}.out")
        for end in list(ends):
            owner = split_port(end)[0]
            if owner and draft.instances[owner].kind == "Negate_dq":
                ends += draft.targets(f"{owner}.out")
        if f"{loop}.in_" in ends:
            found.append(name)
    return found


def frequency_droop(view: View) -> Iterator[Move]:
    """The measured frequency acts on the active power's reference."""
    roles = view.roles
    if roles.frequency is None or not view.known("Gain"):
        return
    for name in roles.outer:
        if view.draft.instances[name].kind != "PI":
            continue
        for filtered in (False, True):

            def path(draft: Draft, name: str = name, filtered: bool = filtered) -> None:
                gain = draft.add("Gain", "frequency_droop")
                for source in frequency_sources(draft, roles):
                    draft.connect(source, f"{gain}.in_")
                draft.connect(f"{gain}.out", f"{name}.in_")
                if filtered:
                    draft.insert_before(f"{gain}.in_", "LPF1", "frequency_filter")

            yield Move(f"a droop of the {'filtered ' * filtered}frequency to {name}", path)
