"""What stands in front of the PLL: a low-pass, a notch, or both."""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, cutoff, in_place
from ibrid.parts.editing.paths import row_before
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.shaping import bypassed, put_before, shape, shapers
from ibrid.parts.editing.view import Move, View
from ibrid.signals import Signal

STEMS = {"LPF1": "pll_filter", "Notch": "pll_notch"}
CORNER = cutoff(400, 100, 20)


def _pll_prefilter(view: View) -> Iterator[Move]:
    for pll in view.draft.having(Element.PLL):
        target = f"{pll}.e_q"
        row = row_before(view.draft, target)
        for name in row:
            yield bypassed(name, f"{name} before {target}")
            for kind in STEMS:
                if kind != view.shipped(name):

                    def exchanged(draft: Edit, name: str = name, kind: str = kind) -> None:
                        draft.replace(
                            name, kind, STEMS[kind], **in_place(shape(draft, kind, CORNER))
                        )

                    yield Move.at(
                        "replace",
                        f"{kind} in place of the {view.kind(name)} {name} before {target}",
                        exchanged,
                    )
        for kind in STEMS:

            def added(draft: Edit, target: str = target, kind: str = kind) -> None:
                draft.insert_before(target, kind, STEMS[kind], **shape(draft, kind, CORNER))

            further = "a further " if any(view.shipped(name) == kind for name in row) else ""
            yield Move.at("add", f"{further}{kind} before {target}", added)


PLL_PREFILTER = Effect(
    id="pll_prefilter",
    law="SRF_PLL takes omega_c/(s + omega_c) e_q, or e_q behind a notch",
    places="before the PLL: LPF1, Notch; one for the other; a second one",
    signature="around the filter's corner, usually 5 to 500 Hz; qq most (about half), in "
    "proportion to the current at rest",
    confused_with=("pll_missing", "pll_sequence_filter", "voltage_sensor"),
    told_apart_by="operating points with different currents, and points around the PLL's "
    "bandwidth, where its peak moves",
    moves=_pll_prefilter,
)


def synchronisation_filter(view: View) -> Iterator[Move]:
    """In front of the PLL."""
    for name in view.draft.having(Element.PLL):
        for kind in shapers(view, Signal.SCALAR):
            yield put_before(f"{kind} before the PLL", f"{name}.e_q", kind, "pll", CORNER)


def filtered_synchronisation(view: View) -> bool:
    """True when something stands in front of a PLL."""
    plls = view.draft.having(Element.PLL)
    return any(f"{view.roles.plant}.e_q" not in view.draft.sources(f"{name}.e_q") for name in plls)


_BANDS = (0.3, 1.0, 0.5, 0.1)

FAMILIES = (
    Family(
        "PLL filter",
        "module",
        _BANDS,
        5.0,
        where_missing(synchronisation_filter, filtered_synchronisation),
    ),
    Family(
        "other PLL filter",
        "module",
        _BANDS,
        0.3,
        where_present(synchronisation_filter, filtered_synchronisation),
    ),
)
