"""The current loop: there or not, the filter of its measurement, the decoupling of its axes."""

from collections.abc import Callable, Iterator

from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.places import (
    command_entries,
    current_entries,
    current_path,
    decouplings,
    has_line,
    join,
    measured_current,
)
from ibrid.gap.strengths import cutoff, pi_gains

#: Per unit of voltage over current: a small, a usual and a large filter inductance.
INDUCTANCES = (0.03, 0.1, 0.3)
#: The nominal frequency that a bank in seconds assumes, rad/s.
NOMINAL = 377.0


def _current_loop(model: Model) -> Iterator[Insertion]:
    roles = model.roles
    loop = roles.current_loop
    if loop is not None:
        current = measured_current(model)

        def without(draft: Edit) -> None:
            way = current_path(model)
            source = f"{way[-2]}.out" if len(way) > 1 else current
            draft.disconnect(source, f"{loop}.in_")
            draft.bypass(loop)

        yield from model.edited(
            "current_loop_missing", "remove", f"{loop}, so that its reference is the command", without
        )
        return
    plant = roles.plant
    for current in dict.fromkeys((roles.current, f"{plant}.i_g") if has_line(model) else (roles.current,)):
        for cascaded in (False, True):
            how = "with what drove the command as its reference" if cascaded else "beside what drives the command"

            def added(draft: Edit, current: str = current, cascaded: bool = cascaded) -> dict[str, Strength]:
                name = draft.add("PI_dq", "current")
                entries = command_entries(draft, roles.command)
                for source in draft.sources(entries[0]) if cascaded else []:
                    draft.connect(source, f"{name}.in_")
                    for entry in entries:
                        draft.disconnect(source, entry)
                draft.connect(draft.negated(current), f"{name}.in_")
                for entry in entries:
                    draft.connect(f"{name}.out", entry)
                return pi_gains(name, (0.1, 0.4, 1.0), (5.0, 20.0, 100.0), vanishes=not cascaded)

            yield from model.edited("current_loop_missing", "add", f"{current} to {roles.command}, {how}", added)


CURRENT_LOOP_MISSING = Effect(
    id="current_loop_missing",
    law="u_r = (k_P + k_I/s)(i_ref - i)",
    places="between the current reference and the command",
    signature="everywhere below 1 kHz; dd and qq alike, the same at every operating point",
    confused_with=("virtual_impedance",),
    told_apart_by="points below 50 Hz, where an integrating loop leaves no admittance",
    insertions=_current_loop,
)


def _current_filter(model: Model) -> Iterator[Insertion]:
    current = measured_current(model)
    present = [name for name in current_path(model) if model.draft.instances[name].kind == "LPF1_dq"]
    for name in present:
        where = f"{name} behind {current}"
        yield from model.bypassed("current_filter", "remove", where, name)
        yield from _other_extent(model, name, current)
    for what, entries in current_entries(model).items() if not present else ():

        def filtered(draft: Edit, entries: list[str] = entries) -> dict[str, Strength]:
            return {f"{draft.insert(current, entries, 'LPF1_dq', 'current_filter')}.omega_c": cutoff(4000, 1500, 500)}

        yield from model.edited("current_filter", "add", f"behind {current}, for {what}", filtered)


def _other_extent(model: Model, name: str, current: str) -> Iterator[Insertion]:
    """The decoupling takes the filtered current where it took the other, or the other way round."""
    inputs = [f"{one}.in_" for one in decouplings(model)]
    for old, new, what in ((f"{name}.out", current, "unfiltered"), (current, f"{name}.out", "filtered")):
        moved = [one for one in inputs if model.draft.sources(one) == [old]]
        if moved:

            def rewired(draft: Edit, old: str = old, new: str = new, moved: list[str] = moved) -> None:
                for target in moved:
                    draft.disconnect(old, target)
                    draft.connect(new, target)

            where = f"the {what} current at {' and '.join(moved)}"
            yield from model.edited("current_filter", "replace", where, rewired)


CURRENT_FILTER = Effect(
    id="current_filter",
    law="the controller gets omega_c/(s + omega_c) i",
    places="behind the measured current: for loop and decoupling together, for the loop alone",
    signature="above 100 Hz, around the current loop's bandwidth; all entries alike, the same at every operating point",
    confused_with=("command_filter", "control_delay", "current_sensor", "measurement_delay"),
    told_apart_by="the resonance, where the feedforward is not filtered, and points above the corner frequency",
    insertions=_current_filter,
)


def _decoupling(model: Model) -> Iterator[Insertion]:
    roles, current = model.roles, measured_current(model)
    present = decouplings(model)
    for name in present:
        kind = model.draft.instances[name].kind
        yield from model.edited("decoupling", "remove", f"{name} ({kind})", lambda draft, name=name: draft.remove(name))
        other = "JMul" if kind == "JMul_omega" else "JMul_omega"
        if other == "JMul" or roles.frequency is not None:
            frequency = "nominal frequency" if other == "JMul" else "synchronisation's frequency"
            where = f"{name} with the {frequency} ({other} in place of {kind})"
            yield from model.edited("decoupling", "replace", where, other_form(model, name, other))
    for kind in () if present else ("JMul", "JMul_omega") if roles.frequency is not None else ("JMul",):

        def path(draft: Edit, kind: str = kind) -> dict[str, Strength]:
            name = draft.add(kind, "decoupling")
            draft.connect(current, f"{name}.in_")
            join(draft, f"{name}.out", roles.command, roles.command)
            return cross_coupling(draft, model, name, kind, vanishes=True)

        yield from model.edited("decoupling", "add", f"{current} to {roles.command} ({kind})", path)


def other_form(
    model: Model, name: str, kind: str, *, stem: str = "decoupling"
) -> Callable[[Edit], dict[str, Strength]]:
    """The edit that puts the other kind of cross coupling in a module's place, under another name: its L has another unit."""
    fresh = f"{stem}_{'nominal' if kind == 'JMul' else 'pll'}"
    return lambda draft: cross_coupling(draft, model, draft.replace(name, kind, fresh), kind, vanishes=False)


def cross_coupling(draft: Edit, model: Model, name: str, kind: str, *, vanishes: bool) -> dict[str, Strength]:
    """Wire the frequency of a new JMul_omega as the plant's; strengths of it or of a JMul, in the unit of its kind."""
    if kind == "JMul_omega":
        for source in draft.sources(f"{model.roles.plant}.delta_omega"):
            draft.connect(source, f"{name}.delta_omega")
    unit = 1.0 if kind == "JMul_omega" else NOMINAL
    return {f"{name}.L": Strength(tuple(one / unit for one in INDUCTANCES), 0.0 if vanishes else None)}


DECOUPLING = Effect(
    id="decoupling",
    law="u_r += omega_0 L J i (JMul), or with the synchronisation's frequency, L J i + (L/omega_0) J i_eq delta_omega "
    "(JMul_omega)",
    places="from the measured current to the command; one form for the other",
    signature="mild: 20 to 500 Hz, at the current loop's crossover and the resonance; dq and qd. The frequency's part: "
    "below the PLL's bandwidth, in proportion to the current",
    confused_with=("frame_misalignment", "virtual_impedance"),
    told_apart_by="dq and qd with 1 % noise or less between 20 and 500 Hz; the two forms by operating points with other "
    "currents",
    insertions=_decoupling,
)
