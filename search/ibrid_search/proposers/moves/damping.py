"""Feedback of measured dq signals beside the loops: active damping, virtual impedance, whatever else."""

from collections.abc import Iterator

from ibrid.structure.drafting import Draft
from ibrid_search.proposers.moves.drawing import after, summing
from ibrid_search.proposers.moves.family import Move, View
from ibrid_search.proposers.moves.paths import add_crossing, virtual_reactances


def active_damping(view: View) -> Iterator[Move]:
    """The filter's resonance damped by the capacitor's current, or by the fast part of its voltage, fed to the command."""
    roles = view.roles
    if not roles.lcl or not view.known("Gain_dq"):
        return

    def current(draft: Draft) -> None:
        source = after(draft, f"{roles.plant}.i_C", "Gain_dq", "damping")
        draft.connect(source, summing(draft, roles.command))

    yield Move("active damping by the capacitor current", current)
    if view.known("LPF1_dq"):

        def fast(draft: Draft) -> None:
            slow = after(draft, roles.voltage, "LPF1_dq", "damping_filter")
            gain = draft.add("Gain_dq", "damping")
            draft.chain(roles.voltage, f"{gain}.in_", draft.negated(slow), f"{gain}.in_")
            draft.connect(f"{gain}.out", summing(draft, roles.command))

        yield Move("active damping by the fast part of the filter voltage", fast)


def damped(view: View) -> bool:
    """True when a gain of the capacitor's current, or of the fast part of the voltage, acts on the command."""
    draft, roles = view.draft, view.roles
    for name in draft.named("Gain_dq"):
        sources = draft.sources(f"{name}.in_")
        fast = roles.voltage in sources and len(sources) > 1
        if (fast or f"{roles.plant}.i_C" in sources) and roles.command in draft.targets(f"{name}.out"):
            return True
    return False


def virtual_impedance(view: View) -> Iterator[Move]:
    """A voltage drop of the grid current taken off the voltage that a grid-forming controller makes."""
    roles = view.roles
    if roles.voltage_loop is None and roles.current_loop is not None:
        return  # there is no voltage to take it off
    target = f"{roles.voltage_loop}.in_" if roles.voltage_loop else roles.command
    current = f"{roles.plant}.i_g"
    for kind, words in (("JMul_omega", "reactance with the controller's frequency"), ("JMul", "reactance")):
        if view.known(kind) and (kind == "JMul" or roles.frequency is not None):

            def crossed(draft: Draft, kind: str = kind) -> None:
                drop = add_crossing(draft, view, kind, current, "virtual_reactance")
                draft.connect(draft.negated(drop), summing(draft, target))

            yield Move(f"a virtual {words}", crossed)
    if view.known("Gain_dq"):

        def resistive(draft: Draft) -> None:
            drop = after(draft, current, "Gain_dq", "virtual_resistance")
            draft.connect(draft.negated(drop), summing(draft, target))

        yield Move("a virtual resistance", resistive, 0.5)


def with_virtual_impedance(view: View) -> bool:
    """True when the reference of the voltage loop has a virtual reactance."""
    return bool(virtual_reactances(view))


def feedback(view: View) -> Iterator[Move]:
    """Further feedback of measured dq signals, as it is, scaled or crossed, wherever references and commands add up."""
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
                    draft.connect(after(draft, port, kind, "feedback"), summing(draft, target))

                cross = "the " if kind == "Gain_dq" else "the crossed "
                yield Move(f"{cross}{what} fed to the {where}", path)
            if port == grid and target != roles.command:
                yield Move(
                    f"the {what} added to the {where}",
                    lambda draft, port=port, target=target: draft.connect(port, target),
                )
