"""Paths added to a controller: feedforward, decoupling, damping, a droop of the frequency."""

from collections.abc import Iterator

from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port
from search.proposers.moves.drawing import summing
from search.proposers.moves.family import Move, View


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
    roles = view.roles
    for kind in view.known("JMul", "JMul_omega"):
        for port, target, words in (
            (roles.current, roles.command, "current"),
            (roles.voltage, roles.reference, "voltage"),
        ):
            if (words == "voltage" and roles.voltage_loop is None) or (kind == "JMul_omega" and words == "voltage"):
                continue
            if kind == "JMul_omega" and roles.frequency is None:
                continue

            def path(draft: Draft, kind: str = kind, port: str = port, target: str = target) -> None:
                name = draft.add(kind, "decoupling")
                draft.chain(port, f"{name}.in_", f"{name}.out", summing(draft, target))
                if kind == "JMul_omega":
                    for source in draft.sources(f"{roles.plant}.delta_omega"):
                        draft.connect(source, f"{name}.delta_omega")

            frequency = "the measured frequency" if kind == "JMul_omega" else "the nominal frequency"
            yield Move(f"decoupling of the {words} with {frequency}", path)


def decoupled(view: View) -> bool:
    """True when a cross-coupling is there."""
    return bool(view.draft.named("JMul", "JMul_omega"))


def damping(view: View) -> Iterator[Move]:
    """Further feedback of measured dq signals: active damping, virtual impedance, feedforward of the grid current."""
    roles = view.roles
    grid, targets = f"{roles.plant}.i_g", {roles.command: "command", roles.reference: "current reference"}
    if roles.voltage_loop:
        targets[f"{roles.voltage_loop}.in_"] = "voltage reference"
    signals = [(f"{roles.plant}.i_C", "capacitor current")] if roles.lcl else []
    signals += [(grid, "grid current"), (roles.voltage, "filter voltage")]
    for port, what in signals:
        for target, where in targets.items():
            for kind in view.known("Gain_dq", "JMul"):

                def path(draft: Draft, port: str = port, target: str = target, kind: str = kind) -> None:
                    name = draft.add(kind, "feedback")
                    draft.chain(port, f"{name}.in_", f"{name}.out", summing(draft, target))

                cross = "the " if kind == "Gain_dq" else "the crossed "
                yield Move(f"{cross}{what} fed to the {where}", path)
            if port == grid and target != roles.command:
                yield Move(
                    f"the {what} added to the {where}",
                    lambda draft, port=port, target=target: draft.connect(port, target),
                )


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
                (source,) = draft.sources(f"{roles.plant}.delta_omega")[:1]
                gain = draft.add("Gain", "frequency_droop")
                draft.chain(source, f"{gain}.in_", f"{gain}.out", f"{name}.in_")
                if filtered:
                    draft.insert_before(f"{gain}.in_", "LPF1", "frequency_filter")

            yield Move(f"a droop of the {'filtered ' * filtered}frequency to {name}", path)
