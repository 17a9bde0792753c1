"""Between command and filter: the voltage lost to dead time, the angle that a delay leaves, the
hold of a sampled controller.
"""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength
from ibrid.parts.editing.paths import lags
from ibrid.parts.editing.practice import Effect, Family, having, where_missing
from ibrid.parts.editing.view import Move, View

DEAD = {"D": Strength((0.005, 0.02, 0.06), 0.0), "a": Strength((0.05, 0.1, 0.3))}
ANGLE = {"phi": Strength((-0.06, 0.06, -0.3), 0.0)}
PERIOD = {"T_s": Strength((1e-4, 2e-4, 5e-4), 1e-20)}


def _dead_time(view: View) -> Iterator[Move]:
    present = view.draft.having(Element.CONVERTER_LOSS)
    for name in present:
        yield Move.at(
            "remove", f"{name} at {view.roles.command}", lambda draft, name=name: draft.remove(name)
        )
    if not present and view.known("DeadTime"):

        def lost(draft: Edit) -> None:
            name = draft.add("DeadTime", "dead_time", **DEAD)
            draft.chain(view.roles.current, f"{name}.i", f"{name}.out", view.roles.command)

        where = f"at {view.roles.command}, against {view.roles.current}"
        yield Move("dead time of the converter", lost, change="add", where=where)


DEAD_TIME = Effect(
    id="dead_time",
    law="u_r -= D i/sqrt(|i|^2 + a^2): dead time takes voltage against the converter's current, "
    "smoothed by the ripple",
    places="at the converter, behind delay and modulation",
    signature="a resistance at all frequencies that falls with the current at rest, larger across "
    "that current than along it",
    confused_with=("virtual_impedance", "core_saturation"),
    told_apart_by="operating points with different currents: the resistance goes as 1/|i|, that of "
    "a winding stays",
    moves=_dead_time,
)


def _on_command(
    view: View, element: Element, kind: str, stem: str, says: str, strengths: dict[str, Strength]
) -> Iterator[Move]:
    """A block on the whole command, taken out where one is."""
    command = view.roles.command
    present = [name for name in lags(view) if view.element(name) is element]
    for name in present:
        yield Move.at(
            "remove", f"{name}, which {says} {command}", lambda draft, name=name: draft.bypass(name)
        )
    if not present and view.known(kind):
        yield Move(
            f"{kind} on the whole command",
            lambda draft: draft.insert_before(command, kind, stem, **strengths),
            change="add",
            where=f"before {command}, on all that the controller drives it with",
        )


def _turned(view: View) -> Iterator[Move]:
    return _on_command(view, Element.TURN, "Turn", "delay_angle", "turns", ANGLE)


def _held(view: View) -> Iterator[Move]:
    regulated = view.roles.missing_layers < 3  # else there is no controller that could be sampled
    return (
        _on_command(view, Element.HOLD, "ZOH_dq", "hold", "holds", PERIOD)
        if regulated
        else iter(())
    )


DELAY_ANGLE = Effect(
    id="delay_angle",
    law="u_r turned by phi: the part of the delay angle omega_0 T_d that the controller does not "
    "compensate",
    places="before the plant's u_r",
    signature="below 300 Hz, most below the current loop's bandwidth; dq and qd with opposite "
    "signs, the same at every operating "
    "point; a fit without it takes an absurd R_F",
    confused_with=("control_delay", "decoupling"),
    told_apart_by="points below 100 Hz, where the delay itself does nothing",
    moves=_turned,
)

ZERO_ORDER_HOLD = Effect(
    id="zero_order_hold",
    law="u_r = (1 - exp(-s T_s))/(s T_s) (the whole command): a sampled controller holds it for a "
    "period",
    places="before the plant's u_r",
    signature="as a control delay of half a period, and less gain towards half of the sampling "
    "frequency",
    confused_with=("command_filter", "control_delay", "delay_form"),
    told_apart_by="points above a quarter of the sampling frequency: a hold lowers the gain, a "
    "delay does not",
    moves=_held,
)


FAMILIES = (
    Family(
        "dead time",
        "module",
        (0.7, 1.0, 0.7, 0.3),
        2.0,
        where_missing(_dead_time, having(Element.CONVERTER_LOSS)),
    ),
    Family(
        "delay angle",
        "module",
        (0.5, 1.0, 0.7, 0.3),
        2.0,
        where_missing(_turned, having(Element.TURN)),
    ),
    Family("hold", "module", (0.0, 0.2, 0.7, 1.0), 1.0, where_missing(_held, having(Element.HOLD))),
)
