"""Filters and delays put on a signal: the measured ones, the command, any wire."""

from collections.abc import Iterator

from ibrid.signals import Signal
from ibrid.structure.diagram import TERMINAL_CURRENT
from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port
from ibrid_search.proposers.moves.command import followers, of_circuit
from ibrid_search.proposers.moves.family import Move, View

#: Blocks that shape a signal on its way, most usual first.
SHAPERS = ("LPF1", "Notch", "Pade1")

SHAPERS_DQ = ("LPF1_dq", "Delay", "Pade1_dq")

#: How usual a shaper is, where it is not 1.
UNUSUAL = {"Notch": 0.25, "Pade1": 0.25, "Pade1_dq": 0.25}

#: Names for blocks that are put in, by kind.
STEMS = {
    "LPF1": "filter",
    "LPF1_dq": "filter",
    "Notch": "notch",
    "Pade1": "delay",
    "Pade1_dq": "delay",
    "Delay": "delay",
}


def shapers(view: View, signal: Signal) -> tuple[str, ...]:
    """Filters and delays for a signal: the usual ones and in-line kinds of the user's own with parameters."""
    usual = view.known(*(SHAPERS if signal is Signal.SCALAR else SHAPERS_DQ))
    shipped = {*SHAPERS, *SHAPERS_DQ, "PI", "PI_dq", "Gain", "Gain_dq", "JMul", "Integrator", "Negate", "Negate_dq"}
    own = [k.name for k in view.kinds if k.name not in shipped and k.in_line and k.inputs["in_"] is signal]
    return (*usual, *own)


def synchronisation_filter(view: View) -> Iterator[Move]:
    """In front of the PLL."""
    for name in view.draft.named("SRF_PLL"):
        for kind in shapers(view, Signal.SCALAR):
            yield Move(f"{kind} before the PLL", _before(f"{name}.e_q", kind, f"pll_{_stem(kind)}"), _usual(kind))


def filtered_synchronisation(view: View) -> bool:
    """True when something stands in front of a PLL."""
    return any(
        f"{view.roles.plant}.e_q" not in view.draft.sources(f"{name}.e_q") for name in view.draft.named("SRF_PLL")
    )


def power_filters(view: View) -> Iterator[Move]:
    """On the measured powers: both with one parameter, or one of them."""
    for power in view.roles.power:
        for kind in shapers(view, Signal.SCALAR):

            def both(draft: Draft, power: str = power, kind: str = kind) -> None:
                names = [
                    draft.insert(f"{power}.{axis}", draft.targets(f"{power}.{axis}"), kind, f"{axis}_{_stem(kind)}")
                    for axis in ("p", "q")
                    if draft.targets(f"{power}.{axis}")
                ]
                for name in names[1:]:
                    draft.bind(name, **{key: f"{names[0]}.{key}" for key in draft.kind(name).parameters})

            yield Move(f"{kind} on the measured powers", both, 2 * _usual(kind))
            for axis in ("p", "q"):
                if view.draft.targets(f"{power}.{axis}"):
                    yield Move(
                        f"{kind} on {axis}", _behind(f"{power}.{axis}", kind, f"{axis}_{_stem(kind)}"), _usual(kind)
                    )


def filtered_powers(view: View) -> bool:
    """True when a measured power is filtered."""
    targets = [target for name in view.roles.power for axis in "pq" for target in view.draft.targets(f"{name}.{axis}")]
    return any(view.draft.instances[split_port(target)[0]].kind in SHAPERS for target in targets)


def current_filter(view: View) -> Iterator[Move]:
    """On the measured current: for the whole controller, or for one of its blocks."""
    roles = view.roles
    control = [
        target
        for target in view.draft.targets(roles.current)
        if not of_circuit(view.draft, target) and view.draft.instances[split_port(target)[0]].kind != "PQ_calc"
    ]
    for kind in shapers(view, Signal.DQ_VEC):
        if control:

            def whole(draft: Draft, kind: str = kind) -> None:
                draft.insert(roles.current, control, kind, f"current_{_stem(kind)}")

            yield Move(f"{kind} on the measured current", whole, 2 * _usual(kind))
        for target in control if len(control) > 1 else []:

            def one(draft: Draft, kind: str = kind, target: str = target) -> None:
                draft.insert(roles.current, [target], kind, f"current_{_stem(kind)}")

            yield Move(f"{kind} on the measured current to {split_port(target)[0]} alone", one, _usual(kind))


def voltage_filter(view: View) -> Iterator[Move]:
    """On the measured voltage: in the feedforward, or for the whole controller."""
    roles = view.roles
    bound = followers(view.draft)
    targets = [target for target in view.draft.targets(roles.voltage) if target not in bound]
    for kind in shapers(view, Signal.DQ_VEC):
        for target in targets:

            def one(draft: Draft, kind: str = kind, target: str = target) -> None:
                draft.insert(roles.voltage, [target], kind, f"voltage_{_stem(kind)}")

            yield Move(f"{kind} on the measured voltage to {split_port(target)[0]}", one, _usual(kind))
        if len(targets) > 1:
            yield Move(
                f"{kind} on the measured voltage", _behind(roles.voltage, kind, f"voltage_{_stem(kind)}"), _usual(kind)
            )


def command_delay(view: View) -> Iterator[Move]:
    """On the way to the converter: the whole command, or the controller's part without what is fed forward."""
    roles = view.roles
    for kind in reversed(shapers(view, Signal.DQ_VEC)):
        yield Move(f"{kind} on the whole command", _before(roles.command, kind, f"command_{_stem(kind)}"), _usual(kind))
        if roles.current_loop:
            yield Move(
                f"{kind} behind the current controller",
                _behind(f"{roles.current_loop}.out", kind, f"command_{_stem(kind)}"),
                _usual(kind),
            )


def delayed(view: View) -> bool:
    """True when there is a delay."""
    return bool(view.draft.named("Delay", "Pade1_dq"))


def any_wire(view: View) -> Iterator[Move]:
    """A shaper on any single wire: what the textbook has no name for."""
    for source, target in view.wires:
        name, port = split_port(target)
        if (
            target == TERMINAL_CURRENT
            or "delta" in port
            or port == "v_in"
            or view.draft.instances[name].kind == "DC_link"
        ):
            continue
        for kind in shapers(view, view.draft.signal(source)):

            def put(draft: Draft, kind: str = kind, source: str = source, target: str = target) -> None:
                draft.insert(source, [target], kind, _stem(kind))

            yield Move(f"{kind} between {source} and {target}", put)


def _usual(kind: str) -> float:
    return UNUSUAL.get(kind, 1.0)


def _stem(kind: str) -> str:
    return STEMS.get(kind, kind.lower())


def _before(target: str, kind: str, stem: str):
    return lambda draft: draft.insert_before(target, kind, stem)


def _behind(source: str, kind: str, stem: str):
    return lambda draft: draft.insert(source, draft.targets(source), kind, stem)
