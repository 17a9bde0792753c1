"""The cross coupling of filter inductance and capacitor cancelled, at the nominal frequency or that
of the synchronisation.
"""

from collections.abc import Callable, Iterator

from ibrid.modules.behaviour import COUPLINGS, Element
from ibrid.parts.editing.edit import Edit, Strength
from ibrid.parts.editing.paths import decouplings, frequency_sources, join, measured_current, path
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.view import Move, View
from ibrid.structure.reading.wiring import split_port

#: Per unit of voltage over current: a small, a usual and a large filter inductance.
INDUCTANCES = (0.03, 0.1, 0.3)
#: The nominal frequency that a bank in seconds assumes, rad/s.
NOMINAL = 377.0
#: Kinds of a coupling, at the nominal frequency and at the controller's.
REACTANCES = ("JMul", "JMul_omega")


def couplings_at_hand(view: View) -> tuple[str, ...]:
    """Kinds that this vocabulary has; the measured frequency where there is one."""
    return view.known(*(REACTANCES if view.roles.frequency is not None else REACTANCES[:1]))


def cross_coupling(draft: Edit, view: View, name: str, *, vanishes: bool) -> None:
    """Give a new coupling the frequency of the frame where it takes one, and strengths in the unit
    of its kind.
    """
    measured = draft.kind(name).element is Element.COUPLING_AT_FREQUENCY
    if measured:
        draft.gather(f"{name}.delta_omega", *frequency_sources(draft, view))
    unit = 1.0 if measured else NOMINAL
    draft.usually(
        name, L=Strength(tuple(one / unit for one in INDUCTANCES), 0.0 if vanishes else None)
    )


def coupled(draft: Edit, view: View, source: str, kind: str, stem: str) -> str:
    """The output of a new coupling behind a source."""
    port = draft.after(source, kind, stem)
    cross_coupling(draft, view, split_port(port)[0], vanishes=True)
    return port


def other_form(view: View, name: str, stem: str, where: str) -> Move | None:
    """The other kind of coupling in a module's place, under another name: its L has another unit;
    None without it.
    """
    nominal = view.element(name) is Element.COUPLING
    kinds = view.known(REACTANCES[nominal])
    if not kinds or (nominal and not frequency_sources(view.draft, view)):
        return None

    def draw(draft: Edit) -> None:
        fresh = draft.replace(name, kinds[0], f"{stem}_{'pll' if nominal else 'nominal'}")
        cross_coupling(draft, view, fresh, vanishes=False)

    return Move(f"{kinds[0]} in place of the {view.kind(name)} {name}", draw, where=where)


def _decoupling(view: View) -> Iterator[Move]:
    roles, current = view.roles, measured_current(view)
    present = decouplings(view)
    for name in present:
        kind = view.kind(name)
        yield Move.at("remove", f"{name} ({kind})", lambda draft, name=name: draft.remove(name))
        nominal = view.element(name) is Element.COUPLING
        frequency = "synchronisation's frequency" if nominal else "nominal frequency"
        where = f"{name} with the {frequency} ({REACTANCES[nominal]} in place of {kind})"
        if move := other_form(view, name, "decoupling", where):
            yield move
    for kind in couplings_at_hand(view) if not present else ():
        yield Move.at(
            "add",
            f"{current} to {roles.command} ({kind})",
            _added(view, current, roles.command, kind),
        )


DECOUPLING = Effect(
    id="decoupling",
    law="u_r += omega_0 L J i (JMul), or with the synchronisation's frequency, L J i + (L/omega_0) "
    "J i_eq delta_omega "
    "(JMul_omega)",
    places="from the measured current to the command; one form for the other",
    signature="mild: 20 to 500 Hz, at the current loop's crossover and the resonance; dq and qd. "
    "The frequency's part: "
    "below the PLL's bandwidth, in proportion to the current",
    confused_with=("delay_angle", "frame_misalignment", "virtual_impedance"),
    told_apart_by="dq and qd with 1 % noise or less between 20 and 500 Hz; the two forms by "
    "operating points with other "
    "currents",
    moves=_decoupling,
)


def current_decoupling(view: View) -> Iterator[Move]:
    """The cross-coupling of the filter inductance cancelled, with the nominal or the
    synchronisation's frequency.
    """
    return _crossed(view, measured_current(view), view.roles.command, "current", "decoupling")


def voltage_decoupling(view: View) -> Iterator[Move]:
    """The current of the filter's capacitor that the voltage loop needs, with the nominal or the
    synchronisation's frequency.
    """
    if view.roles.voltage_loop is not None:
        yield from _crossed(
            view, view.roles.voltage, view.roles.reference, "voltage", "voltage_decoupling"
        )


def _crossed(view: View, port: str, target: str, words: str, stem: str) -> Iterator[Move]:
    for kind, frequency in zip(couplings_at_hand(view), ("nominal", "measured"), strict=False):
        draw = _added(view, port, target, kind, stem)
        yield Move(f"decoupling of the {words} with the {frequency} frequency", draw)


def _added(
    view: View, port: str, target: str, kind: str, stem: str = "decoupling"
) -> Callable[[Edit], None]:
    return lambda draft: join(draft, view, coupled(draft, view, port, kind, stem), target)


def decoupled(view: View) -> bool:
    """True when a cross-coupling is there that is neither of the voltage nor a virtual
    reactance.
    """
    others = {*_voltage_crossings(view), *virtual_reactances(view)}
    return any(name not in others for name in view.draft.having(*COUPLINGS))


def voltage_decoupled(view: View) -> bool:
    """True when the filter's voltage has a cross-coupling."""
    return bool(_voltage_crossings(view))


def _voltage_crossings(view: View) -> list[str]:
    crossings = view.draft.having(*COUPLINGS)
    return [name for name in crossings if view.roles.voltage in view.draft.sources(f"{name}.in_")]


def virtual_reactances(view: View) -> list[str]:
    """Cross-couplings that act on the voltage loop's reference."""
    loop = view.roles.voltage_loop
    crossings = view.draft.having(*COUPLINGS) if loop else []
    return [
        name for name in crossings if path(view.draft, f"{name}.out", f"{loop}.in_") is not None
    ]


def coupling_frequency(view: View) -> Iterator[Move]:
    """A reactance that couples the axes, of a decoupling or a virtual impedance, at the measured
    frequency in place of the nominal one, or the other way round.
    """
    for element in COUPLINGS:
        for name in view.draft.having(element):
            if move := other_form(view, name, name, ""):
                yield move


_BANDS = (0.5, 1.0, 0.7, 0.2)

FAMILIES = (
    Family("decoupling", "module", _BANDS, 10.0, where_missing(current_decoupling, decoupled)),
    Family("other decoupling", "module", _BANDS, 0.3, where_present(current_decoupling, decoupled)),
    Family("frequency of a coupling", "module", _BANDS, 4.0, coupling_frequency),
    Family(
        "voltage decoupling",
        "module",
        _BANDS,
        8.0,
        where_missing(voltage_decoupling, voltage_decoupled),
    ),
    Family(
        "other voltage decoupling",
        "module",
        _BANDS,
        0.3,
        where_present(voltage_decoupling, voltage_decoupled),
    ),
)
