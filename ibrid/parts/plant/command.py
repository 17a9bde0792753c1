"""What delays or smooths the whole voltage command on its way to the converter."""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Strength, cutoff
from ibrid.parts.editing.paths import lags
from ibrid.parts.editing.practice import Effect, Family, having, where_missing, where_present
from ibrid.parts.editing.shaping import DELAY_TIME, in_line, put_before, put_behind, shapers
from ibrid.parts.editing.view import Move, View
from ibrid.signals import Signal

DELAYS = (Element.DELAY, Element.PADE)
#: Of a converter modelled or built as a lag.
CORNER = cutoff(3000, 1000, 400)


def _lagged(
    view: View,
    kind: str,
    stem: str,
    elements: tuple[Element, ...],
    says: str,
    **strengths: Strength,
):
    command = view.roles.command
    present = [name for name in lags(view) if view.element(name) in elements]
    places = {
        f"before {command}, on all that drives it": lambda draft: draft.insert_before(
            command, kind, stem, **strengths
        )
    }
    return in_line(present, f"{{}}, which {says} {command}", places)


def _control_delay(view: View) -> Iterator[Move]:
    return _lagged(view, "Delay", "delay", DELAYS, "delays", T_d=DELAY_TIME)


CONTROL_DELAY = Effect(
    id="control_delay",
    law="u_r = exp(-s T_d) (the whole command, feedforward included)",
    places="before the plant's u_r",
    signature="50 Hz to 2 kHz, most around the resonance and the current loop's bandwidth; all "
    "entries alike, the same at "
    "every operating point",
    confused_with=(
        "command_filter",
        "current_filter",
        "delay_angle",
        "delay_form",
        "measurement_delay",
        "measurement_filter",
        "voltage_feedforward_filter",
        "zero_order_hold",
    ),
    told_apart_by="points above 0.3/(2 pi T_d) with 2 % noise or less: the phase of a delay goes "
    "on falling",
    moves=_control_delay,
)


def _command_filter(view: View) -> Iterator[Move]:
    filters = (Element.LOW_PASS,)
    return _lagged(view, "LPF1_dq", "command_filter", filters, "filters", omega_c=CORNER)


COMMAND_FILTER = Effect(
    id="command_filter",
    law="u_r = omega_c/(s + omega_c) (the whole command): a converter modelled or built as a lag",
    places="before the plant's u_r",
    signature="as a control delay, and less gain above the corner frequency",
    confused_with=("control_delay", "current_filter", "delay_form", "zero_order_hold"),
    told_apart_by="points above the corner frequency: a filter lowers the gain, a delay does not",
    moves=_command_filter,
)


def command_delay(view: View) -> Iterator[Move]:
    """On the way to the converter: the whole command, or the controller's part without what is fed
    forward.
    """
    roles = view.roles
    for kind in reversed(shapers(view, Signal.DQ_VEC)):
        yield put_before(f"{kind} on the whole command", roles.command, kind, "command", CORNER)
        if roles.current_loop:
            note = f"{kind} behind the current controller"
            yield put_behind(note, f"{roles.current_loop}.out", kind, "command", CORNER)


_BANDS, _DELAYED = (0.0, 0.3, 1.0, 1.0), having(*DELAYS, signal=Signal.DQ_VEC)

FAMILIES = (
    Family("command delay", "module", _BANDS, 5.0, where_missing(command_delay, _DELAYED)),
    Family("other delay", "module", _BANDS, 0.3, where_present(command_delay, _DELAYED)),
)
