"""Structural edits: the filter, the synchronisation, the current, voltage and power loops, each added or replaced whole."""

from collections.abc import Iterator

from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.drafting import Draft
from ibrid.structure.roles import Roles
from ibrid.structure.wiring import split_port
from search.proposers.moves.family import Family, Move, View, where_missing, where_present


def _plant(view: View) -> Iterator[Move]:
    """The other filter; with an LCL the controller measures the converter's or the grid's current."""
    roles = view.roles
    if not roles.lcl and view.known("LCL"):

        def converter_side(draft: Draft) -> None:
            plant = _other_plant(draft, roles, "LCL")
            for target in list(draft.targets(f"{plant}.i_g")):
                name = split_port(target)[0]
                if name and draft.instances[name].kind not in ("Rot_i", "PQ_calc"):
                    draft.disconnect(f"{plant}.i_g", target)
                    draft.connect(f"{plant}.i_ti", target)

        def grid_side(draft: Draft) -> None:
            _other_plant(draft, roles, "LCL")

        yield Move("LCL filter instead of the L filter, control of the converter current", converter_side)
        yield Move("LCL filter instead of the L filter, control of the grid current", grid_side)
    if roles.lcl and view.known("LFilter"):

        def single(draft: Draft) -> None:
            for target in list(draft.targets(f"{roles.plant}.i_ti")):
                draft.connect(f"{roles.plant}.i_g", target)
            _other_plant(draft, roles, "LFilter")

        yield Move("L filter instead of the LCL filter", single)


def _other_plant(draft: Draft, roles: Roles, kind: str) -> str:
    """Exchange the plant under its old name, so that the program keeps reading well."""
    draft.rename(draft.replace(roles.plant, kind, "filter_to_be"), roles.plant)
    return roles.plant


def _synchronisation(view: View) -> Iterator[Move]:
    """A PLL, or a droop of the active power, each with the rotations into its frame."""
    roles, kind = view.roles, _kind_of(view, view.roles.frequency)
    if not view.known("Rot_v") or not view.known("Rot_i"):
        return
    if kind != "SRF_PLL" and view.known("SRF_PLL"):

        def pll(draft: Draft) -> None:
            name = draft.add("SRF_PLL", "pll")
            draft.connect(f"{roles.plant}.e_q", f"{name}.e_q")
            _synchronise(draft, roles, f"{name}.delta_omega", f"{name}.delta")

        yield Move("synchronisation by a PLL, with the rotations into its frame", pll)
    if view.known("PQ_calc") and view.known("Integrator"):
        for filtered in (True, False):

            def droop(draft: Draft, filtered: bool = filtered) -> None:
                source = draft.negated(f"{_power(draft, roles)}.p")
                if filtered:
                    source = _after(draft, source, "LPF1", "droop_filter")
                frequency = _after(draft, source, "Gain", "droop")
                angle = _after(draft, frequency, "Integrator", "angle")
                _synchronise(draft, roles, frequency, angle)

            how = "a droop of the filtered active power" if filtered else "a droop of the active power"
            yield Move(f"synchronisation by {how} (grid-forming)", droop)


def _no_synchronisation(view: View) -> Iterator[Move]:
    roles = view.roles
    if roles.frequency is None and not roles.rotated:
        return

    def fixed(draft: Draft) -> None:
        for name in draft.named("Rot_v"):
            for target in draft.targets(f"{name}.v_dq"):
                draft.connect(TERMINAL_VOLTAGE, target)
            draft.remove(name)
        for name in draft.named("Rot_i"):
            for source in draft.sources(f"{name}.i_dq"):
                draft.connect(source, TERMINAL_CURRENT)
            draft.remove(name)
        for source in draft.sources(f"{roles.plant}.delta_omega"):
            draft.disconnect(source, f"{roles.plant}.delta_omega")

    yield Move("no synchronisation: the controller works in the grid's frame", fixed)


def _synchronise(draft: Draft, roles: Roles, frequency: str, angle: str) -> None:
    """Let frequency and angle come from new sources; rotate the terminals if that is not done yet."""
    for rotation, port in (("Rot_v", "delta"), ("Rot_i", "delta")):
        for name in draft.named(rotation):
            for source in draft.sources(f"{name}.{port}"):
                draft.disconnect(source, f"{name}.{port}")
            draft.connect(angle, f"{name}.{port}")
    targets = [f"{roles.plant}.delta_omega"]
    targets += [f"{name}.delta_omega" for name in draft.named("JMul_omega")]
    for target in targets:
        for source in draft.sources(target):
            draft.disconnect(source, target)
        draft.connect(frequency, target)
    if not draft.named("Rot_v"):
        consumers = draft.targets(TERMINAL_VOLTAGE)
        name = draft.add("Rot_v", "park_v")
        for target in consumers:
            draft.disconnect(TERMINAL_VOLTAGE, target)
            draft.connect(f"{name}.v_dq", target)
        draft.chain(TERMINAL_VOLTAGE, f"{name}.v_DQ", angle, f"{name}.delta")
    if not draft.named("Rot_i"):
        sources = draft.sources(TERMINAL_CURRENT)
        name = draft.add("Rot_i", "park_i")
        for source in sources:
            draft.disconnect(source, TERMINAL_CURRENT)
            draft.connect(source, f"{name}.i_dq")
        draft.chain(f"{name}.i_DQ", TERMINAL_CURRENT, angle, f"{name}.delta")


def _current_loop(view: View) -> Iterator[Move]:
    """A PI controller of the measured current; what drove the command becomes its reference or stays beside it."""
    roles = view.roles
    if roles.current_loop is not None or not view.known("PI_dq"):
        return
    currents = [(roles.current, "converter current" if roles.lcl else "current")]
    if roles.lcl:
        currents.append((f"{roles.plant}.i_g", "grid current"))
    for port, words in currents:
        for what in ("alone", "with the old command as its reference", "beside the old command"):

            def loop(draft: Draft, port: str = port, what: str = what) -> None:
                name = draft.add("PI_dq", "current")
                for source in draft.sources(roles.command) if what != "beside the old command" else []:
                    draft.disconnect(source, roles.command)
                    if what != "alone":
                        draft.connect(source, f"{name}.in_")
                draft.chain(draft.negated(port), f"{name}.in_", f"{name}.out", roles.command)

            yield Move(f"a PI controller of the {words}, {what}", loop)


def _voltage_loop(view: View) -> Iterator[Move]:
    """A PI controller of the filter's voltage in front of the current loop or on the command (grid-forming)."""
    roles = view.roles
    if roles.voltage_loop is not None or not roles.lcl or not view.known("PI_dq"):
        return
    for what in ("with the outer loops as its reference", "beside the outer loops"):

        def loop(draft: Draft, what: str = what) -> None:
            name = draft.add("PI_dq", "voltage")
            if what.startswith("with"):
                for source in draft.sources(roles.reference):
                    if split_port(source)[0] and draft.instances[split_port(source)[0]].kind == "PackDQ":
                        draft.disconnect(source, roles.reference)
                        draft.connect(source, f"{name}.in_")
            draft.chain(draft.negated(roles.voltage), f"{name}.in_", f"{name}.out", roles.reference)

        yield Move(f"a PI controller of the filter voltage, {what}", loop)


def _power_loops(view: View) -> Iterator[Move]:
    """PI control of p and q through the d and q axis of the reference: both, alike or with gains of their own, or one."""
    roles = view.roles
    if not view.known("PQ_calc") or not view.known("PI"):
        return
    for axes in ("pq", "p", "q"):
        for alike in (True, False) if axes == "pq" else (False,):

            def loops(draft: Draft, axes: str = axes, alike: bool = alike) -> None:
                power = _power(draft, roles)
                if "p" in axes:
                    regulator = draft.add("PI", "p_loop")
                    draft.connect(draft.negated(f"{power}.p"), f"{regulator}.in_")
                    _to_axis(draft, f"{regulator}.out", roles.reference, "in_d")
                if "q" in axes:
                    other = draft.add("PI", "q_loop")
                    draft.connect(f"{power}.q", f"{other}.in_")
                    _to_axis(draft, f"{other}.out", roles.reference, "in_q")
                    if alike:
                        draft.bind(other, kP=f"{regulator}.kP", kI=f"{regulator}.kI")

            how = {"pq": "p and q", "p": "p", "q": "q"}[axes]
            gains = {True: ", one pair of gains", False: ", gains of their own" if axes == "pq" else ""}[alike]
            yield Move(f"PI control of {how}{gains}", loops)


def _missing_axis(view: View) -> Iterator[Move]:
    """The reference of one axis has an outer loop and the other none: a loop of the other power, with gains of its own or
    those of the one that is there, or of the voltage magnitude."""
    roles = view.roles
    free = [axis for axis in ("in_d", "in_q") if not _regulated(view, axis)]
    if len(free) != 1 or not view.known("PQ_calc") or not view.known("PI"):
        return
    (axis,), twins = free, [name for name in roles.outer if view.draft.instances[name].kind == "PI"]
    for like in (None, *twins):

        def loop(draft: Draft, like: str | None = like) -> None:
            power = _power(draft, roles)
            regulator = draft.add("PI", "p_loop" if axis == "in_d" else "q_loop")
            source = draft.negated(f"{power}.p") if axis == "in_d" else f"{power}.q"
            draft.connect(source, f"{regulator}.in_")
            _to_axis(draft, f"{regulator}.out", roles.reference, axis)
            if like is not None:
                bound = draft.instances[like].bindings
                draft.bind(regulator, **{key: bound.get(key, f"{like}.{key}") for key in ("kP", "kI")})

        what = "p" if axis == "in_d" else "q"
        yield Move(f"PI control of {what}" + (f" with the gains of {like}" if like else " too"), loop)
    if axis == "in_q":
        yield from (move for move in _voltage_magnitude(view) if "PI" in move.note)


def _regulated(view: View, axis: str) -> bool:
    """True when an outer loop drives this axis of the current loop's reference."""
    draft = view.draft
    packs = {split_port(source)[0] for source in draft.sources(view.roles.reference)} & set(draft.named("PackDQ"))
    return any(set(view.roles.outer) & draft.upstream(f"{pack}.{axis}", without=view.roles.plant) for pack in packs)


def _voltage_magnitude(view: View) -> Iterator[Move]:
    """Outer control of the voltage: PI on its magnitude to the q axis, or a droop of q to the d axis."""
    roles = view.roles
    if view.known("SliceD") and view.known("PI"):

        def ac_voltage(draft: Draft) -> None:
            magnitude = _after(draft, roles.voltage, "SliceD", "magnitude")
            _to_axis(draft, _after(draft, magnitude, "PI", "ac_voltage"), roles.reference, "in_q")

        yield Move("PI control of the voltage magnitude on the q axis", ac_voltage)
    if view.known("PQ_calc") and view.known("Gain"):
        target = f"{roles.voltage_loop}.in_" if roles.voltage_loop else roles.reference
        for filtered in (True, False):

            def droop(draft: Draft, filtered: bool = filtered) -> None:
                source = draft.negated(f"{_power(draft, roles)}.q")
                if filtered:
                    source = _after(draft, source, "LPF1", "q_filter")
                _to_axis(draft, _after(draft, source, "Gain", "q_droop"), target, "in_d")

            yield Move(f"a droop of the {'filtered ' * filtered}reactive power on the d axis", droop)


def loop_removals(view: View) -> Iterator[Move]:
    """One loop less; its reference takes its place."""
    roles = view.roles
    for name, words in ((roles.current_loop, "current"), (roles.voltage_loop, "voltage")):
        if name is None:
            continue

        def drop(draft: Draft, name: str = name, measured: str = words) -> None:
            port = roles.voltage if measured == "voltage" else roles.current
            for source in draft.sources(f"{name}.in_"):
                before = split_port(source)[0]
                if before and draft.instances[before].kind == "Negate_dq" and port in draft.sources(f"{before}.in_"):
                    draft.disconnect(source, f"{name}.in_")
            draft.bypass(name)

        yield Move(f"no {words} loop", drop)
    for name in roles.outer:

        def cut(draft: Draft, name: str = name) -> None:
            draft.remove(name)

        yield Move(f"without {name}, an outer {view.draft.instances[name].kind}", cut)
    if len(roles.outer) > 1:

        def cut_all(draft: Draft) -> None:
            for name in roles.outer:
                draft.remove(name)

        yield Move("without outer loops", cut_all)


def _kind_of(view: View, name: str | None) -> str | None:
    return view.draft.instances[name].kind if name is not None else None


def _power(draft: Draft, roles: Roles) -> str:
    """The module that computes p and q from the filter's voltage and the grid current; a new one if there is none."""
    if roles.power and roles.power[0] in draft.instances:
        return roles.power[0]
    found = draft.named("PQ_calc")
    name = found[0] if found else draft.add("PQ_calc", "power")
    draft.chain(roles.voltage, f"{name}.e", f"{roles.plant}.i_g", f"{name}.i")
    return name


def _after(draft: Draft, source: str, kind: str, stem: str) -> str:
    """The output of a new block behind a source."""
    name = draft.add(kind, stem)
    draft.connect(source, f"{name}.in_")
    return f"{name}.out"


def _to_axis(draft: Draft, source: str, target: str, axis: str) -> None:
    """Let a scalar drive one axis of a dq input, in place of what drove that axis before."""
    packs = [split_port(one)[0] for one in draft.sources(target)]
    packs = [name for name in packs if name and draft.instances[name].kind == "PackDQ"]
    pack = packs[0] if packs else draft.add("PackDQ", "reference")
    for old in draft.sources(f"{pack}.{axis}"):
        draft.disconnect(old, f"{pack}.{axis}")
    draft.connect(source, f"{pack}.{axis}")
    draft.connect(f"{pack}.out", target)


def _lcl(view: View) -> bool:
    return view.roles.lcl


def _synchronised(view: View) -> bool:
    return view.roles.frequency is not None


def _outer(view: View) -> bool:
    return bool(view.roles.outer)


SUB_LOOPS = (
    Family("filter", "structural", (0.2, 0.4, 1.0, 1.0), 9.0, where_missing(_plant, _lcl)),
    Family("other filter", "structural", (0.2, 0.4, 1.0, 1.0), 0.5, where_present(_plant, _lcl)),
    Family(
        "synchronisation", "structural", (1.0, 1.0, 0.5, 0.3), 9.0, where_missing(_synchronisation, _synchronised), True
    ),
    Family(
        "other synchronisation", "structural", (1.0, 1.0, 0.5, 0.1), 0.5, where_present(_synchronisation, _synchronised)
    ),
    Family("no synchronisation", "structural", (0.5, 0.5, 0.2, 0.1), 0.1, _no_synchronisation),
    Family("current loop", "structural", (0.5, 1.0, 1.0, 0.5), 9.0, _current_loop, True),
    Family("voltage loop", "structural", (1.0, 1.0, 0.5, 0.1), 0.5, _voltage_loop),
    Family("power loops", "structural", (1.0, 1.0, 0.3, 0.3), 9.0, where_missing(_power_loops, _outer), True),
    Family("missing axis", "structural", (1.0, 1.0, 0.3, 0.3), 6.0, _missing_axis),
    Family("other power loops", "structural", (1.0, 1.0, 0.3, 0.1), 0.3, where_present(_power_loops, _outer)),
    Family("voltage magnitude", "structural", (1.0, 0.7, 0.2, 0.1), 0.5, _voltage_magnitude),
    Family("one loop less", "structural", (0.5, 0.5, 0.3, 0.2), 0.3, loop_removals),
)
