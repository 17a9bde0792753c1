"""In which form a device has its delays: exact, as Pade forms, or as the hold of a sampled
controller.

Most simulations replace exp(-s T) by a Pade form of low order, and a sampled controller holds its
command: a model with another form differs from the device where s T is large, which looks like
missing physics and is none. The form is a hypothesis.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from ibrid.modules.behaviour import Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.editing.edit import Edit, Strength
from ibrid.parts.editing.practice import Effect
from ibrid.parts.editing.view import Move, View
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.wiring import split_port

EXACT, HOLD, SAMPLED = "exact", "hold", "sampled"
#: From the shortest period on: a hold is a delay of half its period, a sampled control one of one
#: and a half.
PERIOD = {"T_s": Strength((5e-5, 1e-4, 2e-4, 4e-4))}
DELAY_TIME = {"T_d": Strength((5e-5, 1.5e-4, 4e-4))}
_PADE = "pade-"


@dataclass(frozen=True)
class DrawnDelay:
    """A delay of a diagram.

    `name` : the block that delays. `hold` : behind a block that delays by one period of a hold,
    that hold. `form` : "exact", "pade-N", "hold", or "sampled" for one period and its hold.
    """

    name: str
    hold: str | None
    form: str


def drawn_delays(draft: Draft) -> tuple[DrawnDelay, ...]:
    """The delays of a diagram with the form of each; holds count where nothing else delays."""
    delaying = draft.having(Element.DELAY, Element.PADE, signal=Signal.DQ_VEC)
    if not delaying:
        return tuple(
            DrawnDelay(name, None, HOLD)
            for name in draft.having(Element.HOLD, signal=Signal.DQ_VEC)
        )
    holds = {name: _own_hold(draft, name) for name in delaying}
    return tuple(
        DrawnDelay(name, hold, SAMPLED if hold else form_of(draft.kind(name)))
        for name, hold in holds.items()
    )


def form_of(kind: ModuleKind) -> str:
    """The form in which a kind draws a delay."""
    if kind.element is Element.PADE:
        return f"{_PADE}{len(kind.states) // 2}"
    return HOLD if kind.element is Element.HOLD else EXACT


def delay_forms(diagram: Diagram, kinds: Vocabulary) -> tuple[str, ...]:
    """The forms that occur in a diagram, each once, in its order."""
    return tuple(dict.fromkeys(one.form for one in drawn_delays(Draft(diagram, kinds))))


def words_of_form(form: str) -> str:
    """A form in words, behind the name of a delay."""
    return f"as {_form(form)}" if form != EXACT else "exactly"


def said_of(form: str, delay: str) -> str:
    """What has a delay in a form, as a verb and the delay."""
    if form.startswith(_PADE):
        return f"approximates {delay} by {_form(form)}"
    return f"has {delay} {'exact' if form == EXACT else words_of_form(form)}"


def _form(form: str) -> str:
    if form.startswith(_PADE):
        return f"a Pade form of order {form.removeprefix(_PADE)}"
    return {HOLD: "the hold of a sampled signal", SAMPLED: "one period and the hold behind it"}[
        form
    ]


def _own_hold(draft: Draft, name: str) -> str | None:
    """The hold that a delay alone drives and whose period is its time."""
    (time,) = draft.kind(name).parameters
    behind = {split_port(target)[0] for target in draft.targets(f"{name}.out")} - {""}
    if len(behind) != 1 or draft.kind(hold := behind.pop()).element is not Element.HOLD:
        return None
    (period,) = draft.kind(hold).parameters
    times = [
        draft.instances[block].bindings.get(key) for block, key in ((name, time), (hold, period))
    ]
    named = [f"{block}.{key}" for block, key in ((name, time), (hold, period))]
    shared = [
        value if isinstance(value, str | float) else own
        for value, own in zip(times, named, strict=True)
    ]
    return hold if shared[0] == shared[1] else None


def _forms(view: View) -> Iterator[Move]:
    """All delays of a device in another form at once: who has one in that form has the others in
    it.
    """
    delays = drawn_delays(view.draft)
    drawing = {form_of(kind): kind.name for kind in reversed(view.kinds) if _draws(kind)}
    forms = [EXACT, *sorted(form for form in drawing if form.startswith(_PADE)), HOLD]
    offered = [form for form in forms if form in drawing]
    offered += [SAMPLED] if EXACT in drawing and HOLD in drawing else []
    names = " and ".join(one.name for one in delays)
    own, same = ("its delay", "it") if len(delays) == 1 else ("its delays", "them")
    for form in offered if delays else ():
        if any(one.form != form for one in delays):
            where = f"{names} {words_of_form(form)}"
            says = (
                f"the device {said_of(form, own)}, where the model {said_of(delays[0].form, same)}"
            )
            yield Move(
                "",
                partial(_draw_in_form, delays=delays, form=form, drawing=drawing),
                where=where,
                says=says,
            )


def _draws(kind: ModuleKind) -> bool:
    """True for a kind in line on dq vectors that draws a delay by its time alone."""
    in_form = kind.element in (Element.DELAY, Element.PADE, Element.HOLD)
    return in_form and kind.signal is Signal.DQ_VEC and len(kind.parameters) == 1


def _draw_in_form(
    draft: Edit, delays: tuple[DrawnDelay, ...], form: str, drawing: dict[str, str]
) -> None:
    for delay in delays:
        if delay.form == form:
            continue
        if delay.hold:
            draft.bypass(delay.hold)
            draft.unbind(delay.name, *draft.kind(delay.name).parameters)
        strengths = DELAY_TIME if {delay.form, form} & {HOLD, SAMPLED} else {}
        if form != SAMPLED:
            draft.redraw(delay.name, drawing[form], **(PERIOD if form == HOLD else strengths))
            continue
        draft.redraw(delay.name, drawing[EXACT])
        hold = draft.insert(
            f"{delay.name}.out", draft.targets(f"{delay.name}.out"), drawing[HOLD], "hold", **PERIOD
        )
        (time,), (period,) = draft.kind(delay.name).parameters, draft.kind(hold).parameters
        draft.bind(delay.name, **{time: f"{hold}.{period}"})


DELAY_FORM = Effect(
    id="delay_form",
    law="exp(-s T_d) exact; approximated by a Pade form of order 1, (1 - s T_d/2)/(1 + s T_d/2), "
    "to 4; held, "
    "(1 - exp(-s T_s))/(s T_s); or held behind exp(-s T_s): the form in which the device has its "
    "delays",
    places="every delay of a device, all in one form",
    signature="where s T_d is large: from 1/(4 T_d) on for a Pade form of order 1, higher for "
    "more; nothing below",
    confused_with=(
        "control_delay",
        "command_filter",
        "measurement_delay",
        "voltage_feedforward_filter",
        "zero_order_hold",
    ),
    told_apart_by="points above 1/(4 T_d), with little noise; or a look into the simulation",
    moves=_forms,
    form=True,
)
