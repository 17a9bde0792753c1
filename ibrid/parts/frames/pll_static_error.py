"""Where the voltage rests in the frame of a PLL beside its d axis: without integral action, by a
reference, at a fixed angle.
"""

from collections.abc import Iterator, Mapping

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength
from ibrid.parts.editing.paths import row_before
from ibrid.parts.editing.practice import Effect
from ibrid.parts.editing.view import Move, View
from ibrid.parts.frames.sequence import locked_vector, own_q_axis
from ibrid.parts.frames.synchronisation import PLL_GAINS

#: Voltage on the q axis at rest, per unit. A PLL with that reference and integral action is the
#: usual one at a reference of zero; one without integral action is another one at any.
ON_Q = (0.05, -0.05, 0.2)
#: Angle by which the voltage that a PLL holds on its d axis is ahead of the measured one, rad.
ANGLE = {"phi": Strength((-0.05, 0.05, -0.2), 0.0)}
#: Kinds of a PLL, each with how strong its numbers are.
KINDS: Mapping[str, Mapping[str, Strength]] = {
    "SRF_PLL": PLL_GAINS,
    "SRF_PLL_P": {"kP_pll": PLL_GAINS["kP_pll"], "e_q_ref": Strength(ON_Q)},
    "SRF_PLL_ref": PLL_GAINS | {"e_q_ref": Strength(ON_Q, 0.0)},
}
#: How a PLL of a kind rests, said of it by name.
RESTS: Mapping[str, str] = {
    "SRF_PLL": "has integral action, so that it rests with e_q = 0",
    "SRF_PLL_P": "has no integral action, so that it rests with e_q = e_q_ref, (omega - "
    "omega_pll)/kP_pll",
    "SRF_PLL_ref": "holds e_q by integral action at a reference e_q_ref",
}


def _pll_static_error(view: View) -> Iterator[Move]:
    for pll in view.draft.having(Element.PLL):
        yield from _other_pll(view, pll)
        yield from _turned_voltage(view, pll)


def _other_pll(view: View, pll: str) -> Iterator[Move]:
    model = RESTS.get(view.shipped(pll), f"is a {view.kind(pll)}")
    for kind in KINDS:
        if kind == view.shipped(pll) or not view.known(kind):
            continue
        where = f"{kind} in place of the {view.kind(pll)} {pll}"
        says = f"the PLL {pll} of the device {RESTS[kind]}, while that of the model {model}"
        yield Move(
            "", lambda draft, kind=kind: exchange_pll(draft, pll, kind), where=where, says=says
        )


def exchange_pll(draft: Edit, pll: str, kind: str) -> None:
    """Put another of `KINDS` in a PLL's place, under its name; the numbers that both have stay as
    they are bound.

    Raises NotInVocabulary.
    """
    before = draft.kind(pll).parameters
    kept = {
        key: value for key, value in draft.instances[pll].bindings.items() if key in KINDS[kind]
    }
    draft.rename(draft.replace(pll, kind, pll, **kept), pll)
    draft.usually(
        pll, **{key: strength for key, strength in KINDS[kind].items() if key not in before}
    )


def _turned_voltage(view: View, pll: str) -> Iterator[Move]:
    locked = locked_vector(view, pll)
    if locked is None or not view.known("Turn"):
        return
    entry, q_axis = locked
    row = row_before(view.draft, f"{q_axis}.in_") if q_axis else ()
    present = [name for name in row if view.element(name) is Element.TURN]
    for name in present:

        def without(draft: Edit, name: str = name) -> None:
            draft.bypass(name)
            own_q_axis(draft, view)

        where = f"{name}, which turns the voltage to which {pll} locks"
        says = (
            f"the PLL {pll} of the device rests with the voltage on its d axis, that of the model "
            f"at an angle ({name})"
        )
        yield Move("", without, change="remove", where=where, says=says)
    if present:
        return

    def turned(draft: Edit) -> None:
        if q_axis:
            draft.insert_before(f"{q_axis}.in_", "Turn", "pll_angle", **ANGLE)
        else:
            voltage = draft.after(view.roles.voltage, "Turn", "pll_angle", **ANGLE)
            draft.drive(entry, draft.after(voltage, "SliceQ", "pll_q"))

    says = (
        f"the PLL {pll} of the device rests with the voltage at a constant angle to its d axis, "
        "that of the model on it"
    )
    yield Move(
        "", turned, change="add", where=f"Turn on the voltage to which {pll} locks", says=says
    )


PLL_STATIC_ERROR = Effect(
    id="pll_static_error",
    law="the PLL rests with e_q = e_q_ref: without integral action beside its own frequency, "
    "(omega - omega_pll)/kP_pll; "
    "with a reference of e_q; or it holds the voltage at a constant angle -phi to its d axis",
    places="the PLL itself: SRF_PLL_P, SRF_PLL_ref; a Turn of the voltage to which it locks",
    signature="below the PLL's bandwidth; the column of v_d, which a PLL with the voltage on its d "
    "axis does not hear",
    confused_with=("pll_missing",),
    told_apart_by="points below the PLL's bandwidth at two currents: what v_d does there goes with "
    "the current at rest",
    moves=_pll_static_error,
)
