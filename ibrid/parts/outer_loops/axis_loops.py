"""What stands in the place of the loops of p and q: the DC link on the d axis, the AC voltage on
the q axis.
"""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength, pi_gains
from ibrid.parts.editing.paths import drive_axis, regulates, regulator
from ibrid.parts.editing.practice import Effect, Family
from ibrid.parts.editing.view import Move, View


def _axis_loop(
    view: View, axis: str, what: str, there: str, power: str, source: str, draw
) -> Iterator[Move]:
    """An effect that regulates an axis of the reference in the place of a power.

    what, there : what it regulates, and in words. source : of what comes in. draw : (draft, view,
    vanishes) puts it in.
    """
    present = regulator(view, axis)
    measured = regulates(view, present)
    if measured == what and present is not None:
        yield Move.at("remove", f"{present}, {there}", lambda draft: draft.remove(present))
    if present is None or measured == power:
        where = f"{source} to {axis} of the current reference" + (
            f" in place of {present}" if present else ""
        )
        change = "replace" if present else "add"
        yield Move.at(change, where, lambda draft: draw(draft, view, present is None))


def _ac_voltage_loop(view: View) -> Iterator[Move]:
    source, there = f"|{view.roles.voltage}|", "the loop of the AC voltage"
    return _axis_loop(view, "in_q", "voltage", there, "q", source, _with_ac_voltage)


def _with_ac_voltage(draft: Edit, view: View, vanishes: bool, kind: str = "Magnitude") -> None:
    gains = pi_gains((0.05, 0.2, 1.0), (5.0, 30.0, 150.0), vanishes=vanishes)
    loop = draft.after(draft.after(view.roles.voltage, kind, "e_size"), "PI", "ac_voltage", **gains)
    drive_axis(draft, loop, view.roles.reference, "in_q")


AC_VOLTAGE_LOOP = Effect(
    id="ac_voltage_loop",
    law="i_ref_q = -(k_P + k_I/s)(V* - |e|)",
    places="on the q axis of the current reference, in place of the q loop where there is one",
    signature="below 50 Hz; qd and qq; towards 0 Hz the voltage is stiff",
    confused_with=("reactive_loop_missing", "voltage_droop"),
    told_apart_by="points below 5 Hz, where a loop of the voltage makes its column large",
    moves=_ac_voltage_loop,
)


def _dc_link(view: View) -> Iterator[Move]:
    return _axis_loop(
        view,
        "in_d",
        "dc",
        "the loop of the DC voltage, and the DC link",
        "p",
        "v_dc",
        _with_dc_link,
    )


def _with_dc_link(draft: Edit, view: View, vanishes: bool) -> None:
    capacitor = draft.add(
        "DC_link", "dc_link", C_dc=Strength((0.05, 0.02, 0.008))
    )  # its u follows the command
    draft.connect(view.roles.current, f"{capacitor}.i")
    gains = pi_gains((2.0, 1.5, 1.0), (80.0, 50.0, 20.0), vanishes=vanishes)
    drive_axis(
        draft,
        draft.after(f"{capacitor}.v_dc", "PI", "dc_voltage", **gains),
        view.roles.reference,
        "in_d",
    )


DC_LINK = Effect(
    id="dc_link",
    law="C_dc v_dc v_dc' = P_in - u_r' i_ti (C_dc in s), i_ref_d = (k_P + k_I/s)(v_dc - 1)",
    places="on the d axis of the current reference, in place of the p loop where there is one",
    signature="5 to 100 Hz; dd most (more than 80 %), less at low power",
    confused_with=("power_loop_missing",),
    told_apart_by="operating points with different powers, and points around the DC-voltage loop's "
    "bandwidth",
    moves=_dc_link,
)


def ac_voltage_loop(view: View) -> Iterator[Move]:
    """PI control of the magnitude of the filter's voltage on the q axis, in place of what drives
    that.
    """
    there = view.roles.voltage_loop is not None or view.draft.having(Element.MAGNITUDE)
    kinds = view.known("Magnitude", "SliceD")  # the same where the frame lies on the voltage
    if kinds and view.known("PI") and not there:
        note = "PI control of the voltage magnitude on the q axis"
        yield Move(note, lambda draft: _with_ac_voltage(draft, view, False, kinds[0]))


def dc_voltage_loop(view: View) -> Iterator[Move]:
    """A DC link that the converter unloads, and PI control of its voltage on the d axis, in place
    of what drives that.
    """
    there = view.roles.voltage_loop is not None or view.draft.having(Element.DC_LINK)
    if view.knows("DC_link", "PI") and not there:
        note = "PI control of the voltage of a DC link on the d axis"
        yield Move(note, lambda draft: _with_dc_link(draft, view, vanishes=False))


FAMILIES = (
    Family("AC voltage", "structural", (1.0, 0.7, 0.2, 0.1), 0.3, ac_voltage_loop, if_gross=1.5),
    Family("DC link", "structural", (1.0, 1.0, 0.3, 0.1), 0.3, dc_voltage_loop, if_gross=1.5),
)
