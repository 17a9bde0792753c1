"""Edits of one component: a filter, delay or path added, a block exchanged for another or taken away."""

from collections.abc import Iterator
from itertools import combinations

from ibrid.modules.kind import ModuleKind
from ibrid.signals import Signal
from ibrid.structure.diagram import TERMINAL_CURRENT
from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port
from search.proposers.moves.family import Family, Move, View, where_missing, where_present

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


def in_line(kind: ModuleKind) -> bool:
    """True for a block of one input in_ and one output out of the same signal."""
    return set(kind.inputs) == {"in_"} and set(kind.outputs) == {"out"} and kind.inputs["in_"] is kind.outputs["out"]


def _shapers(view: View, signal: Signal) -> tuple[str, ...]:
    """Filters and delays for a signal: the usual ones and in-line kinds of the user's own with parameters."""
    usual = view.known(*(SHAPERS if signal is Signal.SCALAR else SHAPERS_DQ))
    shipped = {*SHAPERS, *SHAPERS_DQ, "PI", "PI_dq", "Gain", "Gain_dq", "JMul", "Integrator", "Negate", "Negate_dq"}
    own = [k.name for k in view.kinds if k.name not in shipped and in_line(k) and k.inputs["in_"] is signal]
    return (*usual, *own)


def _synchronisation_filter(view: View) -> Iterator[Move]:
    for name in view.draft.named("SRF_PLL"):
        for kind in _shapers(view, Signal.SCALAR):
            yield Move(f"{kind} before the PLL", _before(f"{name}.e_q", kind, f"pll_{_stem(kind)}"), _usual(kind))


def _power_filters(view: View) -> Iterator[Move]:
    for power in view.roles.power:
        for kind in _shapers(view, Signal.SCALAR):

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


def _current_filter(view: View) -> Iterator[Move]:
    roles = view.roles
    control = [
        target
        for target in view.draft.targets(roles.current)
        if target != TERMINAL_CURRENT and view.draft.instances[split_port(target)[0]].kind not in ("Rot_i", "PQ_calc")
    ]
    for kind in _shapers(view, Signal.DQ_VEC):
        if control:

            def whole(draft: Draft, kind: str = kind) -> None:
                draft.insert(roles.current, control, kind, f"current_{_stem(kind)}")

            yield Move(f"{kind} on the measured current", whole, 2 * _usual(kind))
        for target in control if len(control) > 1 else []:

            def one(draft: Draft, kind: str = kind, target: str = target) -> None:
                draft.insert(roles.current, [target], kind, f"current_{_stem(kind)}")

            yield Move(f"{kind} on the measured current to {split_port(target)[0]} alone", one, _usual(kind))


def _voltage_filter(view: View) -> Iterator[Move]:
    """On the measured voltage: in the feedforward, or for the whole controller."""
    roles = view.roles
    targets = view.draft.targets(roles.voltage)
    for kind in _shapers(view, Signal.DQ_VEC):
        for target in targets:

            def one(draft: Draft, kind: str = kind, target: str = target) -> None:
                draft.insert(roles.voltage, [target], kind, f"voltage_{_stem(kind)}")

            yield Move(f"{kind} on the measured voltage to {split_port(target)[0]}", one, _usual(kind))
        if len(targets) > 1:
            yield Move(
                f"{kind} on the measured voltage", _behind(roles.voltage, kind, f"voltage_{_stem(kind)}"), _usual(kind)
            )


def _command_delay(view: View) -> Iterator[Move]:
    """On the way to the converter: the whole command, or the controller's part without what is fed forward."""
    roles = view.roles
    for kind in reversed(_shapers(view, Signal.DQ_VEC)):
        yield Move(f"{kind} on the whole command", _before(roles.command, kind, f"command_{_stem(kind)}"), _usual(kind))
        if roles.current_loop:
            yield Move(
                f"{kind} behind the current controller",
                _behind(f"{roles.current_loop}.out", kind, f"command_{_stem(kind)}"),
                _usual(kind),
            )


def _any_edge(view: View) -> Iterator[Move]:
    """A shaper on any single wire: what the textbook has no name for."""
    for source, target in view.draft.wires:
        if target == TERMINAL_CURRENT or "delta" in split_port(target)[1] or split_port(target)[1] == "v_in":
            continue
        for kind in _shapers(view, view.draft.signal(source)):

            def put(draft: Draft, kind: str = kind, source: str = source, target: str = target) -> None:
                draft.insert(source, [target], kind, _stem(kind))

            yield Move(f"{kind} between {source} and {target}", put)


def _feedforward(view: View) -> Iterator[Move]:
    """The measured voltage added to the command, as it is, scaled or filtered."""
    roles = view.roles
    if roles.command not in view.draft.targets(roles.voltage):
        yield Move("voltage feedforward", lambda draft: draft.connect(roles.voltage, _summing(draft, roles.command)))
    for kind, words in (("Gain_dq", "scaled "), ("LPF1_dq", "filtered ")):
        if view.known(kind):

            def path(draft: Draft, kind: str = kind) -> None:
                draft.disconnect(roles.voltage, roles.command)
                name = draft.add(kind, "feedforward")
                draft.chain(roles.voltage, f"{name}.in_", f"{name}.out", _summing(draft, roles.command))

            yield Move(f"{words}voltage feedforward", path)


def _decoupling(view: View) -> Iterator[Move]:
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
                draft.chain(port, f"{name}.in_", f"{name}.out", _summing(draft, target))
                if kind == "JMul_omega":
                    for source in draft.sources(f"{roles.plant}.delta_omega"):
                        draft.connect(source, f"{name}.delta_omega")

            frequency = "the measured frequency" if kind == "JMul_omega" else "the nominal frequency"
            yield Move(f"decoupling of the {words} with {frequency}", path)


def _damping(view: View) -> Iterator[Move]:
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
                    draft.chain(port, f"{name}.in_", f"{name}.out", _summing(draft, target))

                cross = "the " if kind == "Gain_dq" else "the crossed "
                yield Move(f"{cross}{what} fed to the {where}", path)
            if port == grid and target != roles.command:
                yield Move(
                    f"the {what} added to the {where}",
                    lambda draft, port=port, target=target: draft.connect(port, target),
                )


def _frequency_droop(view: View) -> Iterator[Move]:
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


#: Kinds that take each other's place, by what they do.
_EXCHANGES = (
    ("PI", "Gain", "Integrator"),
    ("PI_dq", "Gain_dq"),
    ("LPF1", "Notch", "Pade1"),
    ("LPF1_dq", "Delay", "Pade1_dq"),
    ("JMul", "JMul_omega"),
    ("Gain_dq", "LPF1_dq"),
    ("Gain", "LPF1"),
)

#: Exchanges that often pay: something that fits anything for something with a meaning, a nominal for a measured frequency.
USUAL_EXCHANGES = {
    ("Notch", "LPF1"): 2.0,
    ("Pade1", "LPF1"): 2.0,
    ("Pade1_dq", "LPF1_dq"): 2.0,
    ("Pade1_dq", "Delay"): 2.0,
    ("Gain_dq", "PI_dq"): 2.0,
    ("Gain", "PI"): 2.0,
    ("Integrator", "PI"): 2.0,
    ("JMul", "JMul_omega"): 4.0,
    ("JMul_omega", "JMul"): 2.0,
}


def _exchange(view: View) -> Iterator[Move]:
    for name, one in view.draft.instances.items():
        for group in _EXCHANGES:
            for kind in view.known(*(other for other in group if one.kind in group and other != one.kind)):

                def swap(draft: Draft, name: str = name, kind: str = kind) -> None:
                    fresh = draft.replace(name, kind, f"{name}_{kind.lower()}" if name in STEMS.values() else name)
                    if kind == "JMul_omega":
                        for source in draft.sources(f"{view.roles.plant}.delta_omega"):
                            draft.connect(source, f"{fresh}.delta_omega")

                usual = USUAL_EXCHANGES.get((one.kind, kind), 0.5)
                yield Move(f"{kind} in place of the {one.kind} {name}", swap, usual)


def removals(view: View) -> Iterator[Move]:
    """One block less: a block in line is bypassed or its path cut, any other goes with its path."""
    for name in view.draft.instances:
        kind = view.draft.kind(name)
        if name == view.roles.plant or kind.name in ("ConstZero", "Rot_v", "Rot_i", "PackDQ"):
            continue
        if in_line(kind):
            yield Move(f"without the {kind.name} {name}", lambda draft, name=name: draft.bypass(name))
        yield Move(f"without the path through {name}", lambda draft, name=name: draft.remove(name))


def twin_removals(view: View) -> Iterator[Move]:
    """Two blocks that share their parameters go together, as they came."""
    for one, twin in combinations(view.draft.instances.values(), 2):
        kind = view.draft.kind(one.name)
        pairs = [
            (one.bindings.get(key, f"{one.name}.{key}"), twin.bindings.get(key, f"{twin.name}.{key}"))
            for key in kind.parameters
        ]
        if one.kind == twin.kind and in_line(kind) and pairs and all(a == b for a, b in pairs):

            def change(draft: Draft, name: str = one.name, other: str = twin.name) -> None:
                draft.bypass(other)
                draft.bypass(name)

            yield Move(f"without the {one.kind}s {one.name} and {twin.name}", change)


def _summing(draft: Draft, target: str) -> str:
    """Where a new path joins: in front of a delay of the whole command, since that delays whatever is computed."""
    sources = draft.sources(target)
    if len(sources) == 1:
        name = split_port(sources[0])[0]
        if name and draft.instances[name].kind in ("Delay", "Pade1_dq"):
            return f"{name}.in_"
    return target


def _usual(kind: str) -> float:
    return UNUSUAL.get(kind, 1.0)


def _stem(kind: str) -> str:
    return STEMS.get(kind, kind.lower())


def _before(target: str, kind: str, stem: str):
    return lambda draft: draft.insert_before(target, kind, stem)


def _behind(source: str, kind: str, stem: str):
    return lambda draft: draft.insert(source, draft.targets(source), kind, stem)


def _fed_forward(view: View) -> bool:
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


def _decoupled(view: View) -> bool:
    return bool(view.draft.named("JMul", "JMul_omega"))


def _filtered_synchronisation(view: View) -> bool:
    return any(
        f"{view.roles.plant}.e_q" not in view.draft.sources(f"{name}.e_q") for name in view.draft.named("SRF_PLL")
    )


def _filtered_powers(view: View) -> bool:
    targets = [target for name in view.roles.power for axis in "pq" for target in view.draft.targets(f"{name}.{axis}")]
    return any(view.draft.instances[split_port(target)[0]].kind in SHAPERS for target in targets)


def _delayed(view: View) -> bool:
    return bool(view.draft.named("Delay", "Pade1_dq"))


_FEEDFORWARD, _PHASE_LOCKED = (0.3, 1.0, 1.0, 0.5), (0.3, 1.0, 0.5, 0.1)

COMPONENTS = (
    Family("voltage feedforward", "module", _FEEDFORWARD, 10.0, where_missing(_feedforward, _fed_forward)),
    Family("other feedforward", "module", _FEEDFORWARD, 0.5, where_present(_feedforward, _fed_forward)),
    Family("decoupling", "module", (0.5, 1.0, 0.7, 0.2), 10.0, where_missing(_decoupling, _decoupled)),
    Family("other decoupling", "module", (0.5, 1.0, 0.7, 0.2), 0.3, where_present(_decoupling, _decoupled)),
    Family("command delay", "module", (0.0, 0.3, 1.0, 1.0), 5.0, where_missing(_command_delay, _delayed)),
    Family("other delay", "module", (0.0, 0.3, 1.0, 1.0), 0.3, where_present(_command_delay, _delayed)),
    Family(
        "PLL filter", "module", _PHASE_LOCKED, 5.0, where_missing(_synchronisation_filter, _filtered_synchronisation)
    ),
    Family(
        "other PLL filter",
        "module",
        _PHASE_LOCKED,
        0.3,
        where_present(_synchronisation_filter, _filtered_synchronisation),
    ),
    Family("power filters", "module", (0.5, 1.0, 0.3, 0.1), 4.0, where_missing(_power_filters, _filtered_powers)),
    Family("other power filters", "module", (0.5, 1.0, 0.3, 0.1), 0.5, where_present(_power_filters, _filtered_powers)),
    Family("current filter", "module", (0.1, 0.5, 1.0, 0.7), 1.0, _current_filter),
    Family("voltage filter", "module", (0.1, 0.5, 1.0, 0.7), 1.0, _voltage_filter),
    Family("feedback and damping", "module", (0.3, 0.7, 1.0, 0.7), 0.7, _damping),
    Family("frequency droop", "module", (1.0, 0.5, 0.1, 0.0), 0.4, _frequency_droop),
    Family("exchange", "module", (0.5, 0.5, 0.5, 0.5), 3.0, _exchange),
    Family("one block less", "module", (0.3, 0.3, 0.3, 0.3), 0.3, removals),
    Family("any wire", "module", (0.3, 0.3, 0.3, 0.3), 0.2, _any_edge),
)
