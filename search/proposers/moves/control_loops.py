"""The loops of current, voltage and power, each added or taken away whole."""

from collections.abc import Iterator

from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port
from search.proposers.moves.drawing import after, power_module, to_axis
from search.proposers.moves.family import Move, View


def current_loop(view: View) -> Iterator[Move]:
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


def voltage_loop(view: View) -> Iterator[Move]:
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


def power_loops(view: View) -> Iterator[Move]:
    """PI control of p and q through the d and q axis of the reference: both, alike or with gains of their own, or one."""
    roles = view.roles
    if not view.known("PQ_calc") or not view.known("PI"):
        return
    for axes in ("pq", "p", "q"):
        for alike in (True, False) if axes == "pq" else (False,):

            def loops(draft: Draft, axes: str = axes, alike: bool = alike) -> None:
                power = power_module(draft, roles)
                if "p" in axes:
                    regulator = draft.add("PI", "p_loop")
                    draft.connect(draft.negated(f"{power}.p"), f"{regulator}.in_")
                    to_axis(draft, f"{regulator}.out", roles.reference, "in_d")
                if "q" in axes:
                    other = draft.add("PI", "q_loop")
                    draft.connect(f"{power}.q", f"{other}.in_")
                    to_axis(draft, f"{other}.out", roles.reference, "in_q")
                    if alike:
                        draft.bind(other, kP=f"{regulator}.kP", kI=f"{regulator}.kI")

            how = {"pq": "p and q", "p": "p", "q": "q"}[axes]
            gains = {True: ", one pair of gains", False: ", gains of their own" if axes == "pq" else ""}[alike]
            yield Move(f"PI control of {how}{gains}", loops)


def missing_axis(view: View) -> Iterator[Move]:
    """The reference of one axis has an outer loop and the other none: a loop of the other power, with gains of its own or
    those of the one that is there, or of the voltage magnitude."""
    roles = view.roles
    free = [axis for axis in ("in_d", "in_q") if not _regulated(view, axis)]
    if len(free) != 1 or not view.known("PQ_calc") or not view.known("PI"):
        return
    (axis,), twins = free, [name for name in roles.outer if view.draft.instances[name].kind == "PI"]
    for like in (None, *twins):

        def loop(draft: Draft, like: str | None = like) -> None:
            power = power_module(draft, roles)
            regulator = draft.add("PI", "p_loop" if axis == "in_d" else "q_loop")
            source = draft.negated(f"{power}.p") if axis == "in_d" else f"{power}.q"
            draft.connect(source, f"{regulator}.in_")
            to_axis(draft, f"{regulator}.out", roles.reference, axis)
            if like is not None:
                bound = draft.instances[like].bindings
                draft.bind(regulator, **{key: bound.get(key, f"{like}.{key}") for key in ("kP", "kI")})

        what = "p" if axis == "in_d" else "q"
        yield Move(f"PI control of {what}" + (f" with the gains of {like}" if like else " too"), loop)
    if axis == "in_q":
        yield from (move for move in voltage_magnitude(view) if "PI" in move.note)


def _regulated(view: View, axis: str) -> bool:
    """True when an outer loop drives this axis of the current loop's reference."""
    draft = view.draft
    packs = {split_port(source)[0] for source in draft.sources(view.roles.reference)} & set(draft.named("PackDQ"))
    return any(set(view.roles.outer) & draft.upstream(f"{pack}.{axis}", without=view.roles.plant) for pack in packs)


def voltage_magnitude(view: View) -> Iterator[Move]:
    """Outer control of the voltage: PI on its magnitude to the q axis, or a droop of q to the d axis."""
    roles = view.roles
    if view.known("SliceD") and view.known("PI"):

        def ac_voltage(draft: Draft) -> None:
            magnitude = after(draft, roles.voltage, "SliceD", "magnitude")
            to_axis(draft, after(draft, magnitude, "PI", "ac_voltage"), roles.reference, "in_q")

        yield Move("PI control of the voltage magnitude on the q axis", ac_voltage)
    if view.known("PQ_calc") and view.known("Gain"):
        target = f"{roles.voltage_loop}.in_" if roles.voltage_loop else roles.reference
        for filtered in (True, False):

            def droop(draft: Draft, filtered: bool = filtered) -> None:
                source = draft.negated(f"{power_module(draft, roles)}.q")
                if filtered:
                    source = after(draft, source, "LPF1", "q_filter")
                to_axis(draft, after(draft, source, "Gain", "q_droop"), target, "in_d")

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
