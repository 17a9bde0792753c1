"""What stands in front of the PLL: a low-pass, a notch, or both."""

from collections.abc import Iterator
from math import pi

from ibrid.modules.behaviour import Element
from ibrid.parts.edit import Edit, Strength, cutoff
from ibrid.parts.paths import row_before
from ibrid.parts.practice import Effect, Family, where_missing, where_present
from ibrid.parts.shaping import bypassed, put_before, shapers
from ibrid.parts.view import Move, View
from ibrid.signals import Signal

STEMS = {"LPF1": "pll_filter", "Notch": "pll_notch"}


def _pll_prefilter(view: View) -> Iterator[Move]:
    for pll in view.draft.having(Element.PLL):
        target = f"{pll}.e_q"
        row = row_before(view.draft, target)
        for name in row:
            yield bypassed(name, f"{name} before {target}")
            for kind in STEMS:
                if kind != view.shipped(name):

                    def exchanged(draft: Edit, name: str = name, kind: str = kind) -> dict[str, Strength]:
                        return _strengths(draft.replace(name, kind, STEMS[kind]), kind, vanishes=False)

                    yield Move.at(
                        "replace", f"{kind} in place of the {view.kind(name)} {name} before {target}", exchanged
                    )
        for kind in STEMS:

            def added(draft: Edit, target: str = target, kind: str = kind) -> dict[str, Strength]:
                return _strengths(draft.insert_before(target, kind, STEMS[kind]), kind)

            further = "a further " if any(view.shipped(name) == kind for name in row) else ""
            yield Move.at("add", f"{further}{kind} before {target}", added)


def _strengths(name: str, kind: str, *, vanishes: bool = True) -> dict[str, Strength]:
    if kind == "LPF1":
        far = cutoff(400, 100, 20)
        return {f"{name}.omega_c": far if vanishes else Strength(far.bank)}
    hertz, width = (120.0, 120.0, 60.0, 300.0), Strength((4.0, 1.0, 0.7, 0.7), 1e12 if vanishes else None)
    return {f"{name}.omega_n": Strength(tuple(2 * pi * one for one in hertz)), f"{name}.Q": width}


PLL_PREFILTER = Effect(
    id="pll_prefilter",
    law="SRF_PLL takes omega_c/(s + omega_c) e_q, or e_q behind a notch",
    places="before the PLL: LPF1, Notch; one for the other; a second one",
    signature="around the filter's corner, usually 5 to 500 Hz; qq most (about half), in proportion to the current at rest",
    confused_with=("pll_missing", "voltage_sensor"),
    told_apart_by="operating points with different currents, and points around the PLL's bandwidth, where its peak moves",
    moves=_pll_prefilter,
)


def synchronisation_filter(view: View) -> Iterator[Move]:
    """In front of the PLL."""
    for name in view.draft.having(Element.PLL):
        for kind in shapers(view, Signal.SCALAR):
            yield put_before(f"{kind} before the PLL", f"{name}.e_q", kind, "pll")


def filtered_synchronisation(view: View) -> bool:
    """True when something stands in front of a PLL."""
    plls = view.draft.having(Element.PLL)
    return any(f"{view.roles.plant}.e_q" not in view.draft.sources(f"{name}.e_q") for name in plls)


_BANDS = (0.3, 1.0, 0.5, 0.1)

FAMILIES = (
    Family("PLL filter", "module", _BANDS, 5.0, where_missing(synchronisation_filter, filtered_synchronisation)),
    Family("other PLL filter", "module", _BANDS, 0.3, where_present(synchronisation_filter, filtered_synchronisation)),
)
