"""The outer loops of p and q: there or not, alike or with gains of their own."""

from collections.abc import Iterator
from functools import partial

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, pi_gains
from ibrid.parts.editing.paths import drive_axis, power_block, regulates, regulator
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.view import Move, View
from ibrid.parts.frames.synchronisation import grid_forming
from ibrid.parts.outer_loops.axis_loops import ac_voltage_loop, dc_voltage_loop

AXES = {"p": "in_d", "q": "in_q"}
#: What may regulate an axis in the place of p and q.
INSTEAD = {"p": ("dc", "the DC link's"), "q": ("voltage", "the AC-voltage")}


def _loop(
    draft: Edit, view: View, power: str, twin: str | None = None, *, vanishes: bool = False
) -> str:
    """A PI controller on minus p, or on q, that drives its axis, with the gains of a twin if there
    is one; returns its name.
    """
    gains = pi_gains((0.005, 0.02, 0.1), (2.0, 20.0, 60.0), vanishes=vanishes)
    block, name = power_block(draft, view), draft.add("PI", f"{power}_loop", **gains)
    draft.connect(draft.negated(f"{block}.p") if power == "p" else f"{block}.q", f"{name}.in_")
    drive_axis(draft, f"{name}.out", view.roles.reference, AXES[power])
    if twin is not None:
        bound = draft.instances[twin].bindings
        draft.bind(
            name, **{key: bound.get(key, f"{twin}.{key}") for key in draft.kind(twin).parameters}
        )
    return name


def _power_loop(view: View, power: str) -> Iterator[Move]:
    axis = AXES[power]
    present = regulator(view, axis)
    measured = regulates(view, present)
    instead, words = INSTEAD[power]
    if measured == power and present is not None:
        yield Move.at(
            "remove", f"{present}, the loop of {power}", lambda draft: draft.remove(present)
        )
    if present is None or measured == instead:
        where = f"{power} to {axis} of the current reference"
        where += f" in place of {words} loop {present}" if present else ""
        change = "replace" if present else "add"
        yield Move.at(
            change, where, lambda draft: _loop(draft, view, power, vanishes=present is None)
        )
        twin = regulator(view, AXES["q" if power == "p" else "p"])
        if (
            twin is not None
            and view.element(twin) is Element.PI
            and regulates(view, twin) in ("p", "q")
        ):
            where += f", with the gains of {twin}"
            yield Move.at(change, where, lambda draft: _loop(draft, view, power, twin))


def _active_power_loop(view: View) -> Iterator[Move]:
    return _power_loop(view, "p")


def _reactive_power_loop(view: View) -> Iterator[Move]:
    return _power_loop(view, "q")


POWER_LOOP_MISSING = Effect(
    id="power_loop_missing",
    law="i_ref_d = (k_P + k_I/s)(p* - p)",
    places="on the d axis of the current reference: gains of its own, or those of the q loop",
    signature="below 50 Hz; dd, and the value towards 0 Hz: constant power turns the sign of the "
    "conductance",
    confused_with=("dc_link", "power_reference", "reactive_loop_missing"),
    told_apart_by="the admittance below 5 Hz at two powers: with loops of p and q it tends to [[p, "
    "-q], [-q, -p]]/v^2",
    moves=_active_power_loop,
)

REACTIVE_LOOP_MISSING = Effect(
    id="reactive_loop_missing",
    law="i_ref_q = -(k_P + k_I/s)(q* - q)",
    places="on the q axis of the current reference: gains of its own, or those of the p loop",
    signature="below 50 Hz; qd, and the value towards 0 Hz",
    confused_with=("ac_voltage_loop", "power_loop_missing", "power_reference", "voltage_droop"),
    told_apart_by="the admittance below 5 Hz at two reactive powers",
    moves=_reactive_power_loop,
)


def _power_gains(view: View) -> Iterator[Move]:
    p, q = regulator(view, "in_d"), regulator(view, "in_q")
    if (
        p is None
        or q is None
        or view.element(p) is not Element.PI
        or view.element(q) is not Element.PI
    ):
        return
    shared = view.bound(p)
    if shared != view.bound(q) or not all(isinstance(value, str) for value in shared.values()):
        return
    lender = next((name for name in (p, q) if str(shared["kP"]).split(".")[0] == name), p)
    other = q if lender == p else p

    def freed(draft: Edit) -> None:
        draft.unbind(other, "kP", "kI")
        draft.usually(other, **pi_gains((0.01, 0.05, 0.002), (10.0, 50.0, 2.0)))

    yield Move.at("replace", f"gains of its own for {other}, which shares those of {lender}", freed)


POWER_GAINS = Effect(
    id="power_gains",
    law="the loops of p and q have gains of their own where the model gives them one pair",
    places="the second of the two loops",
    signature="below 50 Hz, in the entries of one axis",
    confused_with=("power_filter", "reference_feedforward"),
    told_apart_by="points below 10 Hz, where each axis shows the corner of its own loop",
    moves=_power_gains,
)


def power_loops(view: View) -> Iterator[Move]:
    """PI control of p and q through the d and q axis of the reference: both, alike or with gains of
    their own, or one.
    """
    if not view.knows("PQ_calc", "PI"):
        return
    ways = {
        "p and q, one pair of gains": ("pq", True),
        "p and q, gains of their own": ("pq", False),
        "p": ("p", False),
        "q": ("q", False),
    }
    for words, (powers, alike) in ways.items():

        def loops(draft: Edit, powers: str = powers, alike: bool = alike) -> None:
            twin = None
            for power in powers:
                name = _loop(draft, view, power, twin)
                twin = name if alike else None

        yield Move(f"PI control of {words}", loops)


def missing_axis(view: View) -> Iterator[Move]:
    """The reference of one axis has an outer loop and the other none: a loop of the other power,
    with gains of its own or those of the one that is there, or of the DC link (d) or the voltage
    magnitude (q).
    """
    free = [power for power, axis in AXES.items() if regulator(view, axis) is None]
    if len(free) != 1 or not view.knows("PQ_calc", "PI"):
        return
    (power,), twins = free, [name for name in view.roles.outer if view.element(name) is Element.PI]
    for like in (None, *twins):
        loop = partial(_loop, view=view, power=power, twin=like)
        yield Move(
            f"PI control of {power}" + (f" with the gains of {like}" if like else " too"), loop
        )
    yield from ac_voltage_loop(view) if power == "q" else dc_voltage_loop(view)


def _outer(view: View) -> bool:
    return bool(view.roles.outer) or view.roles.voltage_loop is not None or grid_forming(view)


_BANDS = (1.0, 1.0, 0.3, 0.3)

#: A grid-forming inverter's droop controls p.
FAMILIES = (
    Family("power loops", "structural", _BANDS, 9.0, where_missing(power_loops, _outer), True),
    Family("missing axis", "structural", _BANDS, 6.0, missing_axis),
    Family(
        "other power loops",
        "structural",
        (1.0, 1.0, 0.3, 0.1),
        0.3,
        where_present(power_loops, _outer),
        if_gross=1.0,
    ),
)
