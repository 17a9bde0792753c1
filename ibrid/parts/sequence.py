"""What tells positive from negative sequence: SOGI, DSOGI and double synchronous frame before the PLL and in the feedforward,
resonant control of the negative sequence and of harmonics."""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.edit import Edit, Strength, in_place
from ibrid.parts.feedforward import feedforward
from ibrid.parts.paths import command_entry, join, row_before
from ibrid.parts.practice import Effect, Family, where_missing
from ibrid.parts.view import Move, View

ELEMENTS = (Element.BAND_PASS, Element.POSITIVE_SEQUENCE)
#: Kinds, what a filter is called, and how strong it usually is.
FILTERS: dict[str, dict[str, Strength]] = {
    "DSOGI_dq": {"k": Strength((0.5, 1.41, 4.0))},
    "SOGI_dq": {"k": Strength((0.5, 1.41, 4.0), 1e10)},
    "DDSRF_dq": {"omega_c": Strength((60.0, 250.0, 800.0), 1e-9)},
}
RESONANT = {"k": Strength((0.05, 0.3, 1.0), 0.0), "omega_c": Strength((1.0, 5.0, 20.0))}
#: Multiples of the nominal frequency in dq, in words.
HARMONICS = {2.0: "the negative sequence", 6.0: "the 5th and 7th harmonic"}


def locked_vector(view: View, pll: str) -> tuple[str, str | None] | None:
    """(the scalar input that takes a q axis on the way to a PLL, the SliceQ that makes it or None for the plant's own e_q)."""
    draft = view.draft
    row = row_before(draft, f"{pll}.e_q")
    entry = f"{row[-1]}.in_" if row else f"{pll}.e_q"
    sources = draft.sources(entry)
    if sources == [f"{view.roles.plant}.e_q"]:
        return entry, None
    slices = [name for name in draft.having(Element.SLICE_Q) if sources == [f"{name}.out"]]
    return (entry, slices[0]) if slices else None


def _at_hand(view: View, *kinds: str) -> list[str]:
    """Of some kinds that ship, those that this vocabulary has or something stands in for."""
    return [kind for kind in kinds if view.known(kind)]


def _filters_of(view: View, pll: str) -> list[str]:
    """Sequence filters of the vector to which a PLL locks."""
    locked = locked_vector(view, pll)
    row = row_before(view.draft, f"{locked[1]}.in_") if locked and locked[1] else ()
    return [name for name in row if view.element(name) in ELEMENTS]


def _pll_sequence_filter(view: View) -> Iterator[Move]:
    for pll in view.draft.having(Element.PLL):
        locked, present = locked_vector(view, pll), _filters_of(view, pll)
        for name in present:
            yield Move.at("remove", f"{name} before {pll}", lambda draft, name=name: draft.bypass(name))
            for kind in _at_hand(view, *FILTERS):
                if kind != view.shipped(name):

                    def exchanged(draft: Edit, name: str = name, kind: str = kind) -> None:
                        draft.replace(name, kind, "pll_sequence", **in_place(FILTERS[kind]))

                    note = f"{kind} in place of the {view.kind(name)} {name}"
                    yield Move(note, exchanged, where=f"{note} before {pll}")
        if locked is None or present:
            continue
        for kind in _at_hand(view, *FILTERS):

            def added(draft: Edit, kind: str = kind, entry: str = locked[0], q_axis: str | None = locked[1]) -> None:
                if q_axis:
                    draft.insert_before(f"{q_axis}.in_", kind, "pll_sequence", **FILTERS[kind])
                else:
                    vector = draft.after(view.roles.voltage, kind, "pll_sequence", **FILTERS[kind])
                    draft.drive(entry, draft.after(vector, "SliceQ", "pll_q"))

            yield Move(
                f"{kind} before the PLL", added, change="add", where=f"{kind} on the voltage to which {pll} locks"
            )


PLL_SEQUENCE_FILTER = Effect(
    id="pll_sequence_filter",
    law="SRF_PLL takes the q axis of the voltage behind SOGI_dq, DSOGI_dq or DDSRF_dq",
    places="before the PLL, on the vector: one of the three, one for another",
    signature="10 to 300 Hz, with a zero of the loop at twice the nominal frequency; in sequence coordinates at f0 - f; in "
    "proportion to the current at rest",
    confused_with=("pll_prefilter",),
    told_apart_by="points around f0 and 2 f0: these filters couple the axes, a low-pass or a notch on e_q does not",
    moves=_pll_sequence_filter,
)


def _feedforward_band_pass(view: View) -> Iterator[Move]:
    found, entry = feedforward(view), command_entry(view.draft, view)
    kinds = _at_hand(view, "SOGI_dq", "DSOGI_dq")
    if found is None:
        for kind in kinds:
            yield Move(
                f"voltage feedforward through {kind}",
                lambda draft, kind=kind: join(
                    draft, view, draft.after(view.roles.voltage, kind, "feedforward", **in_place(FILTERS[kind]))
                ),
                change="add",
                where=f"{view.roles.voltage} to {view.roles.command}, through {kind}",
            )
        return
    present = [name for name in found.blocks if view.element(name) in ELEMENTS]
    way = f"on the way from {found.voltage} to {view.roles.command}"
    for name in present:
        yield Move.at("remove", f"{name} {way}", lambda draft, name=name: draft.bypass(name))
    for kind in kinds if not present else ():

        def put(draft: Edit, kind: str = kind) -> None:
            draft.insert(found.last, [entry], kind, "feedforward_sequence", **FILTERS[kind])

        yield Move(f"{kind} in the voltage feedforward", put, change="add", where=f"{kind} {way}")


FEEDFORWARD_BAND_PASS = Effect(
    id="feedforward_band_pass",
    law="u_r += SOGI_dq or DSOGI_dq of the measured voltage",
    places="in the path of the voltage feedforward; the whole path where there is none",
    signature="peaks of the impedance at +-f0 in sequence coordinates; in dq below 200 Hz, dq and qd alike, the same at every "
    "operating point",
    confused_with=("resonant_control", "voltage_feedforward_filter"),
    told_apart_by="points around f0: a band-pass lets DC of the stationary frame not pass, a low-pass does",
    moves=_feedforward_band_pass,
)


def _resonant_control(view: View) -> Iterator[Move]:
    loop, draft = view.roles.current_loop, view.draft
    for name in draft.having(Element.RESONATOR):
        yield Move.at("remove", f"{name} beside {loop}", lambda draft, name=name: draft.remove(name))
    if loop is None or not view.known("Resonant_dq"):
        return
    present = {view.bound(name).get("n") for name in draft.having(Element.RESONATOR)}
    for multiple, words in HARMONICS.items():
        if multiple in present:
            continue

        def beside(draft: Edit, multiple: float = multiple) -> None:
            name = draft.add("Resonant_dq", f"resonant_{multiple:g}", n=multiple, **RESONANT)
            for source in draft.sources(f"{loop}.in_"):
                draft.connect(source, f"{name}.in_")
            for target in draft.targets(f"{loop}.out"):
                draft.connect(f"{name}.out", target)

        note = f"resonant control of {words}"
        yield Move(note, beside, change="add", where=f"{words} ({multiple:g} f0 in dq), beside {loop}")


RESONANT_CONTROL = Effect(
    id="resonant_control",
    law="u_r += k 2 omega_c s/(s^2 + 2 omega_c s + (n omega_0)^2) (i_ref - i), n = 2 or 6",
    places="beside the current loop: the negative sequence of the fundamental, the 5th and 7th harmonic",
    signature="narrow, at n f0: the admittance falls there; all entries alike, the same at every operating point",
    confused_with=("feedforward_band_pass",),
    told_apart_by="five points or more within 10 Hz of n f0",
    moves=_resonant_control,
)


def _filtered_lock(view: View) -> bool:
    return any(_filters_of(view, pll) for pll in view.draft.having(Element.PLL))


def _filtered_forward(view: View) -> bool:
    found = feedforward(view)
    return found is not None and any(view.element(name) in ELEMENTS for name in found.blocks)


def _resonates(view: View) -> bool:
    return bool(view.draft.having(Element.RESONATOR))


FAMILIES = (
    Family(
        "PLL sequence filter", "module", (0.3, 1.0, 0.5, 0.1), 2.0, where_missing(_pll_sequence_filter, _filtered_lock)
    ),
    Family(
        "sequence filter", "module", (0.5, 1.0, 0.5, 0.1), 2.0, where_missing(_feedforward_band_pass, _filtered_forward)
    ),
    Family("resonant control", "module", (0.1, 1.0, 0.7, 0.0), 1.0, where_missing(_resonant_control, _resonates)),
)
