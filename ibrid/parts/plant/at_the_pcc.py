"""What lies at the PCC, in the grid's frame: a shunt, the frame of the measurement, a second
device.
"""

from collections.abc import Iterator

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength
from ibrid.parts.editing.practice import Effect, Family, no_moves, where_missing
from ibrid.parts.editing.view import Move, View
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE


def _shunt_capacitance(view: View) -> Iterator[Move]:
    present = view.draft.having(Element.SHUNT)
    for name in present:
        where = f"{name} between v_DQ and i_DQ"
        yield Move.at("remove", where, lambda draft, name=name: draft.remove(name))
    if not present:

        def shunt(draft: Edit) -> None:
            strengths = {"R": Strength((0.05, 0.1, 0.2)), "C": Strength((0.01, 0.04, 0.15), 1e-12)}
            name = draft.add("Shunt_RC", "shunt", **strengths)
            draft.chain(TERMINAL_VOLTAGE, f"{name}.v", f"{name}.i", TERMINAL_CURRENT)

        yield Move.at("add", "from the PCC (v_DQ, i_DQ) to neutral", shunt)


SHUNT_CAPACITANCE = Effect(
    id="shunt_capacitance",
    law="i_DQ -= Y_sh v_DQ, Y_sh of C with a series R, from the PCC to neutral outside the "
    "inverter",
    places="at the PCC, in the grid's frame",
    signature="above 1 kHz, rising with frequency; dd and qq half each, the same at every "
    "operating point",
    confused_with=("filter_capacitor",),
    told_apart_by="points above 2 kHz: the admittance of a capacitor rises, that of the inverter "
    "falls",
    moves=_shunt_capacitance,
)

FRAME_MISALIGNMENT = Effect(
    id="frame_misalignment",
    law="Y' = R(a) Y R(-a), a constant angle of the measuring frame",
    places="in the measurement: no edit of the program describes it",
    signature="everywhere, in proportion to the asymmetry of Y; dq and qd half each, nothing in "
    "their sum with dd and qq",
    confused_with=("decoupling",),
    told_apart_by="a passive load of known impedance in the inverter's place; its admittance does "
    "not turn",
    moves=no_moves,
    measurement=True,
)


def second_device(view: View) -> Iterator[Move]:
    """An L filter behind a gain in parallel to a device that is alone, without a controller yet; of
    p and q it delivers a share.
    """
    if not view.alone or not view.knows("Share", "LFilter", "Gain_dq"):
        return

    def beside(draft: Edit) -> None:
        half = Strength((0.3, 0.5, 0.7))
        share, plant = (
            draft.add("Share", "share", share_p=half, share_q=half),
            draft.add("LFilter", "plant"),
        )
        gain = draft.add("Gain_dq", "gain", k=Strength((0.1, 0.3, 1.0)))
        draft.chain(
            TERMINAL_VOLTAGE,
            f"{share}.v_DQ",
            f"{share}.v",
            f"{plant}.v_in",
            f"{share}.v",
            f"{gain}.in_",
        )
        draft.chain(f"{gain}.out", f"{plant}.u_r", f"{plant}.i_g", TERMINAL_CURRENT)

    yield Move("a second device in parallel, without a controller yet", beside)


def no_second_device(view: View) -> Iterator[Move]:
    """A device that has no controller taken away; the other delivers everything."""
    if view.alone or view.roles.missing_layers < 3:
        return
    yield Move(
        f"without the device of {view.roles.plant}", lambda draft: draft.remove(*draft.instances)
    )


_BANDS = (1.0, 1.0, 1.0, 1.0)
_WANTED = where_missing(second_device, lambda view: view.roles.missing_layers > 0)

FAMILIES = (
    Family("second device", "structural", _BANDS, 0.005, _WANTED, if_gross=0.1),
    Family("one device less", "structural", _BANDS, 0.2, no_second_device),
)
