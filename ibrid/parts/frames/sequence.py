"""What tells positive from negative sequence: SOGI, DSOGI and double synchronous frame before the
PLL and in the feedforward, resonant control of the negative sequence and of harmonics, dual current
control.
"""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength, cutoff, in_place, pi_gains
from ibrid.parts.editing.feedforward_path import feedforward
from ibrid.parts.editing.paths import (
    command_entry,
    current_path,
    frequency_sources,
    join,
    measured_current,
    row_before,
)
from ibrid.parts.editing.practice import Effect, Family, having, where_missing
from ibrid.parts.editing.view import Move, View
from ibrid.structure.reading.wiring import split_port

ELEMENTS = (Element.BAND_PASS, Element.POSITIVE_SEQUENCE)
#: Kinds, what a filter is called, and how strong it usually is.
FILTERS: dict[str, dict[str, Strength]] = {
    "DSOGI_dq": {"k": Strength((0.5, 1.41, 4.0))},
    "SOGI_dq": {"k": Strength((0.5, 1.41, 4.0), 1e10)},
    "DSOGI_fixed": {"k": Strength((0.5, 1.41, 4.0))},
    "SOGI_fixed": {"k": Strength((0.5, 1.41, 4.0), 1e10)},
    "DDSRF_dq": {"omega_c": Strength((60.0, 250.0, 800.0), 1e-9)},
}
RESONANT = {"k": Strength((0.3, 1.0, 3.0), 0.0), "omega_c": Strength((12.0, 25.0, 60.0))}
#: Of a PI controller of the negative sequence with gains of its own, and of the filter on its
#: reference.
NEGATIVE_GAINS = pi_gains((0.1, 0.3, 1.0), (3.0, 10.0, 30.0), vanishes=True)
NEGATIVE_REFERENCE = cutoff(300, 100, 30, nothing=None)
#: Multiples of the nominal frequency in dq, in words.
HARMONICS = {2.0: "the negative sequence", 6.0: "the 5th and 7th harmonic"}


def locked_vector(view: View, pll: str) -> tuple[str, str | None] | None:
    """(the scalar input that takes a q axis on the way to a PLL, the SliceQ that makes it or None
    for the plant's own e_q).
    """
    draft = view.draft
    row = row_before(draft, f"{pll}.e_q")
    entry = f"{row[-1]}.in_" if row else f"{pll}.e_q"
    sources = draft.sources(entry)
    if sources == [f"{view.roles.plant}.e_q"]:
        return entry, None
    slices = [name for name in draft.having(Element.SLICE_Q) if sources == [f"{name}.out"]]
    return (entry, slices[0]) if slices else None


def _at_hand(view: View, *kinds: str) -> list[str]:
    """Of some kinds that ship, those that this vocabulary has or something stands in for; of a
    frame that turns all of them.
    """
    adaptive = [kind for kind in kinds if not kind.endswith("_fixed")]
    return [kind for kind in (kinds if view.roles.frequency else adaptive) if view.known(kind)]


def _tuned(draft: Edit, view: View, name: str) -> str:
    """Let a filter of fixed tuning hear what its frame deviates by; its output."""
    if "delta_omega" in draft.kind(name).inputs and not draft.sources(f"{name}.delta_omega"):
        draft.gather(f"{name}.delta_omega", *frequency_sources(draft, view))
    return f"{name}.out"


def own_q_axis(draft: Edit, view: View) -> None:
    """Let what takes the q axis of the measured voltage take the plant's own e_q."""
    for name in draft.having(Element.SLICE_Q):
        if draft.sources(f"{name}.in_") == [view.roles.voltage]:
            draft.rewire(f"{name}.out", f"{view.roles.plant}.e_q", *draft.targets(f"{name}.out"))


def lock_to(draft: Edit, vector: str, locked: tuple[str, str | None]) -> None:
    """Let a PLL take the q axis of a vector; locked : of `locked_vector`."""
    entry, q_axis = locked
    if q_axis:
        draft.drive(f"{q_axis}.in_", vector)
    else:
        draft.drive(entry, draft.after(vector, "SliceQ", "pll_q"))


def sequence_filters_of(view: View, pll: str) -> list[str]:
    """Sequence filters of the vector to which a PLL locks."""
    locked = locked_vector(view, pll)
    row = row_before(view.draft, f"{locked[1]}.in_") if locked and locked[1] else ()
    return [name for name in row if view.element(name) in ELEMENTS]


def _pll_sequence_filter(view: View) -> Iterator[Move]:
    for pll in view.draft.having(Element.PLL):
        locked, present = locked_vector(view, pll), sequence_filters_of(view, pll)
        for name in present:

            def taken(draft: Edit, name: str = name) -> None:
                draft.bypass(name)
                own_q_axis(draft, view)

            yield Move.at("remove", f"{name} before {pll}", taken)
            for kind in _at_hand(view, *FILTERS):
                if kind != view.shipped(name):

                    def exchanged(draft: Edit, name: str = name, kind: str = kind) -> None:
                        _tuned(
                            draft,
                            view,
                            draft.replace(name, kind, "pll_sequence", **in_place(FILTERS[kind])),
                        )

                    note = f"{kind} in place of the {view.kind(name)} {name}"
                    yield Move(note, exchanged, where=f"{note} before {pll}")
        if locked is None or present:
            continue
        for kind in _at_hand(view, *FILTERS):

            def added(
                draft: Edit,
                kind: str = kind,
                entry: str = locked[0],
                q_axis: str | None = locked[1],
            ) -> None:
                if q_axis:
                    _tuned(
                        draft,
                        view,
                        draft.insert_before(f"{q_axis}.in_", kind, "pll_sequence", **FILTERS[kind]),
                    )
                else:
                    name = split_port(
                        draft.after(view.roles.voltage, kind, "pll_sequence", **FILTERS[kind])
                    )[0]
                    lock_to(draft, _tuned(draft, view, name), (entry, None))

            yield Move(
                f"{kind} before the PLL",
                added,
                change="add",
                where=f"{kind} on the voltage to which {pll} locks",
            )


PLL_SEQUENCE_FILTER = Effect(
    id="pll_sequence_filter",
    law="SRF_PLL takes the q axis of the voltage behind a SOGI, DSOGI or DDSRF_dq, tuned to its "
    "frequency or the nominal one",
    places="before the PLL, on the vector: one of them, one for another",
    signature="10 to 300 Hz, with a zero of the loop at twice the nominal frequency; in sequence "
    "coordinates at f0 - f; in "
    "proportion to the current at rest",
    confused_with=("pll_prefilter",),
    told_apart_by="points around f0 and 2 f0: these filters couple the axes, a low-pass or a notch "
    "on e_q does not",
    moves=_pll_sequence_filter,
)


def _feedforward_band_pass(view: View) -> Iterator[Move]:
    branch, entry = feedforward(view), command_entry(view.draft, view)
    kinds = _at_hand(view, "SOGI_dq", "DSOGI_dq", "SOGI_fixed", "DSOGI_fixed")
    if branch is None:
        for kind in kinds:

            def forward(draft: Edit, kind: str = kind) -> None:
                port = draft.after(
                    view.roles.voltage, kind, "feedforward", **in_place(FILTERS[kind])
                )
                join(draft, view, _tuned(draft, view, split_port(port)[0]))

            where = f"{view.roles.voltage} to {view.roles.command}, through {kind}"
            yield Move(f"voltage feedforward through {kind}", forward, change="add", where=where)
        return
    present = [name for name in branch.blocks if view.element(name) in ELEMENTS]
    way = f"on the way from {branch.voltage} to {view.roles.command}"
    for name in present:
        yield Move.at("remove", f"{name} {way}", lambda draft, name=name: draft.bypass(name))
        if len(branch.blocks) == 1:
            yield Move.at(
                "remove",
                f"the way through {name}",
                lambda draft: draft.disconnect(branch.last, entry),
            )
    for kind in kinds if not present else ():

        def put(draft: Edit, kind: str = kind) -> None:
            _tuned(
                draft,
                view,
                draft.insert(branch.last, [entry], kind, "feedforward_sequence", **FILTERS[kind]),
            )

        yield Move(f"{kind} in the voltage feedforward", put, change="add", where=f"{kind} {way}")


FEEDFORWARD_BAND_PASS = Effect(
    id="feedforward_band_pass",
    law="u_r += SOGI or DSOGI of the measured voltage, tuned to the PLL's frequency or the nominal "
    "one",
    places="in the path of the voltage feedforward; the whole path where there is none",
    signature="peaks of the impedance at +-f0 in sequence coordinates; in dq below 200 Hz, dq and "
    "qd alike, the same at every "
    "operating point",
    confused_with=(
        "resonant_control",
        "voltage_feedforward_filter",
        "negative_sequence_control",
    ),
    told_apart_by="points around f0: a band-pass lets DC of the stationary frame not pass, a "
    "low-pass does",
    moves=_feedforward_band_pass,
)


def _resonant_control(view: View) -> Iterator[Move]:
    loop, draft = view.roles.current_loop, view.draft
    for name in draft.having(Element.RESONATOR):
        yield Move.at(
            "remove", f"{name} beside {loop}", lambda draft, name=name: draft.remove(name)
        )
    if loop is None or not view.known("Resonant_dq"):
        return
    present = {view.bound(name).get("n") for name in draft.having(Element.RESONATOR)}
    for multiple, words in HARMONICS.items():
        if multiple in present:
            continue

        def beside(draft: Edit, multiple: float = multiple) -> None:
            name = draft.add("Resonant_dq", f"resonant_{multiple:g}", n=multiple, **RESONANT)
            draft.gather(f"{name}.in_", *draft.sources(f"{loop}.in_"))
            draft.connect(f"{name}.out", *draft.targets(f"{loop}.out"))

        note = f"resonant control of {words}"
        yield Move(
            note, beside, change="add", where=f"{words} ({multiple:g} f0 in dq), beside {loop}"
        )


RESONANT_CONTROL = Effect(
    id="resonant_control",
    law="u_r += k 2 omega_c s/(s^2 + 2 omega_c s + (n omega_0)^2) (i_ref - i), n = 2 or 6",
    places="beside the current loop: the negative sequence of the fundamental, the 5th and 7th "
    "harmonic",
    signature="narrow, at n f0: the admittance falls there; all entries alike, the same at every "
    "operating point",
    confused_with=("feedforward_band_pass", "negative_sequence_control"),
    told_apart_by="five points or more within 10 Hz of n f0",
    moves=_resonant_control,
)


def _negative_sequence_control(view: View) -> Iterator[Move]:
    loop, draft = view.roles.current_loop, view.draft
    present = draft.having(Element.NEGATIVE_PI)
    for name in present:
        yield Move.at(
            "remove", f"{name} beside {loop}", lambda draft, name=name: draft.remove(name)
        )
    if loop is None or present or not view.known("PI_negative_dq"):
        return
    way = current_path(view)
    entry = f"{way[-2]}.out" if len(way) > 1 else measured_current(view)
    references = [source for source in draft.sources(f"{loop}.in_") if source != entry]
    gains = {key: bound for key, bound in view.bound(loop).items() if key in NEGATIVE_GAINS}

    def filtered(draft: Edit) -> None:
        name = draft.add("PI_negative_dq", "negative_sequence", **gains)
        reference = draft.add("LPF1_dq", "negative_reference", omega_c=NEGATIVE_REFERENCE)
        draft.gather(f"{reference}.in_", *references)
        draft.gather(f"{name}.in_", f"{reference}.out", draft.negated(measured_current(view)))
        draft.connect(f"{name}.out", *draft.targets(f"{loop}.out"))

    def beside(draft: Edit) -> None:
        name = draft.add("PI_negative_dq", "negative_sequence", **NEGATIVE_GAINS)
        draft.gather(f"{name}.in_", *draft.sources(f"{loop}.in_"))
        draft.connect(f"{name}.out", *draft.targets(f"{loop}.out"))

    words = "a PI controller of the negative sequence"
    if references and len(gains) == len(NEGATIVE_GAINS):
        yield Move(
            f"{words} with the gains of {loop}, on the filtered reference",
            filtered,
            change="add",
            where=f"beside {loop}, with its gains, on its filtered reference",
        )
    yield Move(
        f"{words}, with gains of its own",
        beside,
        change="add",
        where=f"beside {loop}, on its error, with gains of its own",
    )


NEGATIVE_SEQUENCE_CONTROL = Effect(
    id="negative_sequence_control",
    law="u_r += (kP + kI/(s + 2 j omega_0)) (i_ref - i), i_ref filtered where the gains are those "
    "of the current loop",
    places="beside the current loop, with its gains or its own",
    signature="dq and qd of opposite sign around 2 f0, where the admittance of the negative "
    "sequence falls; the proportional gain in the whole band of the current loop",
    confused_with=("resonant_control", "feedforward_band_pass"),
    told_apart_by="sequence coordinates: a resonator also acts on the positive sequence at 3 f0, a "
    "PI controller in the frame that turns backwards does not",
    moves=_negative_sequence_control,
)


def _filtered_lock(view: View) -> bool:
    return any(sequence_filters_of(view, pll) for pll in view.draft.having(Element.PLL))


def _filtered_forward(view: View) -> bool:
    found = feedforward(view)
    return found is not None and any(view.element(name) in ELEMENTS for name in found.blocks)


FAMILIES = (
    Family(
        "PLL sequence filter",
        "module",
        (0.3, 1.0, 0.5, 0.1),
        2.0,
        where_missing(_pll_sequence_filter, _filtered_lock),
    ),
    Family(
        "sequence filter",
        "module",
        (0.5, 1.0, 0.5, 0.1),
        2.0,
        where_missing(_feedforward_band_pass, _filtered_forward),
    ),
    Family(
        "resonant control",
        "module",
        (0.1, 1.0, 0.7, 0.0),
        1.0,
        where_missing(_resonant_control, having(Element.RESONATOR)),
    ),
    Family(
        "negative-sequence control",
        "module",
        (0.3, 1.0, 0.7, 0.1),
        1.0,
        where_missing(_negative_sequence_control, having(Element.NEGATIVE_PI)),
    ),
)
