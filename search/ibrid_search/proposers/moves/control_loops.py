"""The inner loops of current and voltage, each added or taken away whole; outer loops taken away."""

from collections.abc import Iterator

from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port
from ibrid_search.proposers.moves.family import Move, View


def current_loop(view: View) -> Iterator[Move]:
    """A PI controller of the measured current; what drove the command becomes its reference or stays beside it.

    Alone it keeps of that only what comes from outer loops, as its reference.
    """
    roles = view.roles
    if roles.current_loop is not None or not view.known("PI_dq"):
        return
    currents = [(roles.current, "converter current" if roles.lcl else "current")]
    if roles.lcl:
        currents.append((f"{roles.plant}.i_g", "grid current"))
    for port, words in currents:
        for what, usual in (
            ("alone", 2.0),
            ("with the old command as its reference", 0.5),
            ("beside the old command", 0.5),
        ):

            def loop(draft: Draft, port: str = port, what: str = what) -> None:
                name = draft.add("PI_dq", "current")
                for source in draft.sources(roles.command) if what != "beside the old command" else []:
                    draft.disconnect(source, roles.command)
                    if what != "alone" or _packed(draft, source):
                        draft.connect(source, f"{name}.in_")
                draft.chain(draft.negated(port), f"{name}.in_", f"{name}.out", roles.command)

            yield Move(f"a PI controller of the {words}, {what}", loop, usual)


def _packed(draft: Draft, source: str) -> bool:
    """True for what comes from a PackDQ, as references of outer loops do."""
    name = split_port(source)[0]
    return bool(name) and draft.instances[name].kind == "PackDQ"


def voltage_loop(view: View) -> Iterator[Move]:
    """A PI controller of the filter's voltage in front of the current loop or on the command (grid-forming)."""
    roles = view.roles
    if roles.voltage_loop is not None or not roles.lcl or not view.known("PI_dq"):
        return
    ways = ["with the outer loops as its reference", "beside the outer loops"]
    if any(view.draft.instances[name].kind == "PI" for name in roles.outer):
        ways.append("in place of the outer loops")
    for what in ways:

        def loop(draft: Draft, what: str = what) -> None:
            name = draft.add("PI_dq", "voltage")
            if what == "in place of the outer loops":
                for outer in roles.outer:
                    draft.remove(outer)
            for source in draft.sources(roles.reference) if what.startswith("with") else []:
                if _packed(draft, source):
                    draft.disconnect(source, roles.reference)
                    draft.connect(source, f"{name}.in_")
            draft.chain(draft.negated(roles.voltage), f"{name}.in_", f"{name}.out", roles.reference)

        yield Move(f"a PI controller of the filter voltage, {what}", loop)


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
