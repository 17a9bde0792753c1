"""The controller's frame in a draft: rotations at the terminals put in, driven otherwise, or taken
out.
"""

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.editing.drafting import Draft


def put_into_frame(draft: Draft, plant: str, frequency: str, angle: str) -> str:
    """Let the frame's frequency and angle come from these sources; returns the terminal voltage in
    that frame.

    The terminals are rotated if that is not done yet; shunts lie outside them and stay in the
    grid's frame.
    """
    for name in draft.having(*ROTATIONS):
        draft.drive(f"{name}.delta", angle)
    for name in (plant, *draft.having(Element.COUPLING_AT_FREQUENCY)):
        draft.drive(f"{name}.delta_omega", frequency)
    outside = draft.having(Element.SHUNT)
    if not draft.having(Element.ROTATION_IN):
        consumers = [
            one for one in draft.targets(TERMINAL_VOLTAGE) if one.partition(".")[0] not in outside
        ]
        name = draft.add(draft.usual(Element.ROTATION_IN), "park_v")
        draft.rewire(TERMINAL_VOLTAGE, f"{name}.v_dq", *consumers)
        draft.chain(TERMINAL_VOLTAGE, f"{name}.v_DQ", angle, f"{name}.delta")
    if not draft.having(Element.ROTATION_OUT):
        sources = [
            one for one in draft.sources(TERMINAL_CURRENT) if one.partition(".")[0] not in outside
        ]
        name = draft.add(draft.usual(Element.ROTATION_OUT), "park_i")
        for source in sources:
            draft.disconnect(source, TERMINAL_CURRENT)
            draft.connect(source, f"{name}.i_dq")
        draft.chain(f"{name}.i_DQ", TERMINAL_CURRENT, angle, f"{name}.delta")
    return f"{draft.having(Element.ROTATION_IN)[0]}.v_dq"


def put_into_grid_frame(draft: Draft) -> None:
    """Take the rotations out: what they turned is wired straight."""
    for name in draft.having(Element.ROTATION_IN):
        draft.connect(TERMINAL_VOLTAGE, *draft.targets(f"{name}.v_dq"))
        draft.remove(name)
    for name in draft.having(Element.ROTATION_OUT):
        draft.gather(TERMINAL_CURRENT, *draft.sources(f"{name}.i_dq"))
        draft.remove(name)
