"""The outer loops that give the reference: of the powers, the voltage magnitude, the DC link, and droops of the voltage."""

from collections.abc import Iterator

from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port
from ibrid_search.proposers.moves.drawing import after, power_module, to_axis
from ibrid_search.proposers.moves.family import Move, View


def power_loops(view: View) -> Iterator[Move]:
    """PI control of p and q through the d and q axis of the reference: both, alike or with gains of their own, or one."""
    roles = view.roles
    if not view.knows("PQ_calc", "PI"):
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
    those of the one that is there, or of the DC link (d) or the voltage magnitude (q)."""
    roles = view.roles
    free = [axis for axis in ("in_d", "in_q") if not regulated(view, axis)]
    if len(free) != 1 or not view.knows("PQ_calc", "PI"):
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
    yield from ac_voltage_loop(view) if axis == "in_q" else dc_voltage_loop(view)


def ac_voltage_loop(view: View) -> Iterator[Move]:
    """PI control of the magnitude of the filter's voltage on the q axis, in place of what drives that."""
    roles = view.roles
    measured = view.known("Magnitude", "SliceD")[:1]  # the same where the frame lies on the voltage
    if not measured or not view.known("PI") or roles.voltage_loop is not None or view.draft.named("Magnitude"):
        return

    def loop(draft: Draft) -> None:
        magnitude = after(draft, roles.voltage, measured[0], "magnitude")
        to_axis(draft, after(draft, magnitude, "PI", "ac_voltage"), roles.reference, "in_q")

    yield Move("PI control of the voltage magnitude on the q axis", loop)


def dc_voltage_loop(view: View) -> Iterator[Move]:
    """A DC link that the converter unloads, and PI control of its voltage on the d axis, in place of what drives that."""
    roles = view.roles
    if not view.knows("DC_link", "PI") or view.draft.named("DC_link") or roles.voltage_loop is not None:
        return

    def loop(draft: Draft) -> None:
        link = draft.add("DC_link", "dc_link")  # its u follows the command
        draft.connect(roles.current, f"{link}.i")
        to_axis(draft, after(draft, f"{link}.v_dc", "PI", "dc_voltage"), roles.reference, "in_d")

    yield Move("PI control of the voltage of a DC link on the d axis", loop)


def voltage_droop(view: View) -> Iterator[Move]:
    """The voltage falls with the reactive power, or is regulated by it: on the d axis of the outermost reference."""
    roles = view.roles
    if not view.known("PQ_calc"):
        return
    target = f"{roles.voltage_loop}.in_" if roles.voltage_loop else roles.reference
    for filtered in (True, False) if view.known("Gain") else ():

        def droop(draft: Draft, filtered: bool = filtered) -> None:
            source = draft.negated(f"{power_module(draft, roles)}.q")
            if filtered:
                source = after(draft, source, "LPF1", "q_filter")
            to_axis(draft, after(draft, source, "Gain", "q_droop"), target, "in_d")

        yield Move(f"a droop of the {'filtered ' * filtered}reactive power on the d axis", droop)
    if view.known("PI") and roles.voltage_loop:

        def regulated(draft: Draft) -> None:
            source = draft.negated(f"{power_module(draft, roles)}.q")
            to_axis(draft, after(draft, source, "PI", "q_loop"), target, "in_d")

        yield Move("PI control of q by the voltage on the d axis", regulated, 0.3)


def regulated(view: View, axis: str) -> bool:
    """True when an outer loop drives this axis of the current loop's reference."""
    draft = view.draft
    packs = {split_port(source)[0] for source in draft.sources(view.roles.reference)} & set(draft.named("PackDQ"))
    return any(set(view.roles.outer) & draft.upstream(f"{pack}.{axis}", without=view.roles.plant) for pack in packs)


def voltage_given(view: View) -> bool:
    """True when something drives the d axis of the voltage loop's reference."""
    draft, loop = view.draft, view.roles.voltage_loop
    packs = {split_port(source)[0] for source in draft.sources(f"{loop}.in_")} & set(draft.named("PackDQ"))
    given = {split_port(source)[0] for pack in packs for source in draft.sources(f"{pack}.in_d")}
    return any(draft.instances[name].kind != "ConstZero" for name in given)
