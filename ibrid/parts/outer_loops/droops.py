"""Droops: frequency and voltage that act on the references of p and q, and reactive power that acts
on the voltage.
"""

from collections.abc import Callable, Iterable, Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength, cutoff, pi_gains
from ibrid.parts.editing.paths import (
    drive_axis,
    frequency_sources,
    path,
    power_block,
    regulates,
    regulator,
)
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.shaping import bypassed
from ibrid.parts.editing.view import Move, View
from ibrid.structure.reading.wiring import split_port

#: Strengths of the two droops: k_f/omega_0 at 60 Hz for k_f of 2, 10, 40; k_v in per unit of q over
#: per unit of voltage. A search tries them with the sign in the gain.
DROOPS = {
    "frequency_droop": Strength((0.005, 0.026, 0.1), 0.0),
    "frequency_droop, signed": Strength((-0.005, -0.026, -0.1), 0.0),
    "voltage_droop": Strength((0.5, 2.0, 8.0), 0.0),
    "q_droop": Strength((0.02, 0.07, 0.3)),
}
SLOW = cutoff(10, 5, 2, nothing=None)


def _frequency_droop(view: View) -> Iterator[Move]:
    loop = regulator(view, "in_d")
    if view.roles.frequency is None or loop is None or regulates(view, loop) != "p":
        return iter(())
    (frequency, *_) = view.draft.sources(f"{view.roles.plant}.delta_omega")
    where = f"{frequency} to {loop}"
    return _droop(
        view, "frequency_droop", frequency, loop, where, lambda draft: draft.negated(frequency)
    )


def _voltage_droop(view: View) -> Iterator[Move]:
    loop = regulator(view, "in_q")
    if loop is None or regulates(view, loop) != "q":
        return iter(())
    voltage = view.roles.voltage
    size = next((f"{name}.out" for name in view.draft.having(Element.MAGNITUDE)), "")
    where = f"|{voltage}| to {loop}"
    return _droop(
        view,
        "voltage_droop",
        size,
        loop,
        where,
        lambda draft: size or draft.after(voltage, "Magnitude", "e_size"),
    )


def _droop(
    view: View, effect: str, source: str, loop: str, where: str, signed: Callable[[Edit], str]
) -> Iterator[Move]:
    """A path with a gain and maybe a filter from a source to the error of a loop; `signed` : where
    it begins.
    """
    target = f"{loop}.in_"
    blocks = list((path(view.draft, source, target) if source else None) or ())
    if any(view.element(name) is Element.GAIN for name in blocks):
        last = f"{blocks[-1]}.out"
        yield Move.at("remove", where, lambda draft: draft.disconnect(last, target))
        filters = [name for name in blocks if view.element(name) is Element.LOW_PASS]
        for name in filters:
            yield bypassed(name, f"{where}, without the filter {name}", "replace")
        if not filters:
            entry, corner = f"{blocks[0]}.in_", cutoff(100, 10, 2)
            yield Move.at(
                "replace",
                f"{where}, behind a low-pass",
                lambda draft: draft.insert_before(entry, "LPF1", "droop_filter", omega_c=corner),
            )
        return
    for filtered in (False, True):

        def droop(draft: Edit, stem: str = "droop_filter" if filtered else "") -> None:
            draft.connect(_gain(draft, [signed(draft)], effect, DROOPS[effect], stem), target)

        yield Move.at("add", where + ", behind a low-pass" * filtered, droop)


def _gain(draft: Edit, sources: Iterable[str], name: str, strength: Strength, low_pass: str) -> str:
    """The output of a gain of some sources, behind a low-pass unless its name is ""."""
    gain = draft.add("Gain", name, k=strength)
    draft.gather(f"{gain}.in_", *sources)
    if low_pass:
        draft.insert_before(f"{gain}.in_", "LPF1", low_pass, omega_c=SLOW)
    return f"{gain}.out"


FREQUENCY_DROOP = Effect(
    id="frequency_droop",
    law="p* -= k_f delta_omega/omega_0, with or without LPF1; the gain's k is k_f/omega_0",
    places="from the PLL's frequency to the error of the p loop",
    signature="below the PLL's bandwidth; the column of v_q in the d row",
    confused_with=("pll_missing",),
    told_apart_by="points between 1 and 10 Hz, where the PLL still follows and the p loop acts",
    moves=_frequency_droop,
)

VOLTAGE_DROOP = Effect(
    id="voltage_droop",
    law="q* -= k_v (|e| - V*), with or without LPF1",
    places="from the magnitude of the measured voltage to the error of the q loop",
    signature="below 50 Hz; lifts qd, dd unchanged",
    confused_with=("ac_voltage_loop", "reactive_loop_missing"),
    told_apart_by="points below 5 Hz: with a droop qd settles at a slope, under voltage control it "
    "does not",
    moves=_voltage_droop,
)


def frequency_droop(view: View) -> Iterator[Move]:
    """The measured frequency acts on the active power's reference; the sign is that of the gain."""
    roles = view.roles
    if roles.frequency is None or not view.known("Gain"):
        return
    for name in roles.outer:
        for filtered in (False, True) if view.element(name) is Element.PI else ():

            def droop(
                draft: Edit, target: str = f"{name}.in_", stem: str = "frequency_filter" * filtered
            ) -> None:
                strength = DROOPS["frequency_droop, signed"]
                gain = _gain(
                    draft, frequency_sources(draft, view), "frequency_droop", strength, stem
                )
                draft.connect(gain, target)

            yield Move(f"a droop of the {'filtered ' * filtered}frequency to {name}", droop)


def reactive_droop(view: View) -> Iterator[Move]:
    """The voltage falls with the reactive power, or is regulated by it: on the d axis of the
    outermost reference.
    """
    roles = view.roles
    if not view.known("PQ_calc"):
        return
    target = f"{roles.voltage_loop}.in_" if roles.voltage_loop else roles.reference
    for filtered in (True, False) if view.known("Gain") else ():

        def droop(draft: Edit, stem: str = "q_filter" * filtered) -> None:
            minus = draft.negated(f"{power_block(draft, view)}.q")
            drive_axis(
                draft, _gain(draft, [minus], "q_droop", DROOPS["q_droop"], stem), target, "in_d"
            )

        yield Move(f"a droop of the {'filtered ' * filtered}reactive power on the d axis", droop)
    if view.known("PI") and roles.voltage_loop:

        def regulated(draft: Edit) -> None:
            minus = draft.negated(f"{power_block(draft, view)}.q")
            gains = pi_gains((0.005, 0.02, 0.1), (2.0, 20.0, 60.0))
            drive_axis(draft, draft.after(minus, "PI", "q_loop", **gains), target, "in_d")

        yield Move("PI control of q by the voltage on the d axis", regulated, 0.3)


def _voltage_to_give(view: View) -> bool:
    """True when nothing drives the d axis of the voltage loop's reference."""
    draft, loop = view.draft, view.roles.voltage_loop
    if loop is None:
        return False
    packs = {split_port(source)[0] for source in draft.sources(f"{loop}.in_")} & set(
        draft.having(Element.PACK)
    )
    given = {split_port(source)[0] for pack in packs for source in draft.sources(f"{pack}.in_d")}
    return all(view.element(name) is Element.ZERO for name in given)


FREQUENCY = (Family("frequency droop", "module", (1.0, 0.5, 0.1, 0.0), 0.4, frequency_droop),)
FAMILIES = (
    Family(
        "voltage droop",
        "structural",
        (1.0, 1.0, 0.3, 0.1),
        6.0,
        where_present(reactive_droop, _voltage_to_give),
    ),
    Family(
        "other voltage droop",
        "structural",
        (1.0, 0.7, 0.2, 0.1),
        0.3,
        where_missing(reactive_droop, _voltage_to_give),
        if_gross=1.0,
    ),
)
