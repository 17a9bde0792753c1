"""The controller's frame in a draft: rotations at the terminals put in, driven otherwise, or taken out."""

from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.drafting import Draft

#: Lies outside the terminals of the inverter, in the grid's frame.
OUTSIDE = "Shunt_RC"


def put_into_frame(draft: Draft, plant: str, frequency: str, angle: str) -> str:
    """Let the frame's frequency and angle come from these sources; returns the terminal voltage in that frame.

    The terminals are rotated if that is not done yet; what lies outside them stays in the grid's frame.
    """
    for name in (*draft.named("Rot_v"), *draft.named("Rot_i")):
        _drive(draft, f"{name}.delta", angle)
    for name in (plant, *draft.named("JMul_omega")):
        _drive(draft, f"{name}.delta_omega", frequency)
    outside = draft.named(OUTSIDE)
    if not draft.named("Rot_v"):
        consumers = [one for one in draft.targets(TERMINAL_VOLTAGE) if one.partition(".")[0] not in outside]
        name = draft.add("Rot_v", "park_v")
        for target in consumers:
            draft.disconnect(TERMINAL_VOLTAGE, target)
            draft.connect(f"{name}.v_dq", target)
        draft.chain(TERMINAL_VOLTAGE, f"{name}.v_DQ", angle, f"{name}.delta")
    if not draft.named("Rot_i"):
        sources = [one for one in draft.sources(TERMINAL_CURRENT) if one.partition(".")[0] not in outside]
        name = draft.add("Rot_i", "park_i")
        for source in sources:
            draft.disconnect(source, TERMINAL_CURRENT)
            draft.connect(source, f"{name}.i_dq")
        draft.chain(f"{name}.i_DQ", TERMINAL_CURRENT, angle, f"{name}.delta")
    return f"{draft.named('Rot_v')[0]}.v_dq"


def put_into_grid_frame(draft: Draft) -> None:
    """Take the rotations out: what they turned is wired straight."""
    for name in draft.named("Rot_v"):
        for target in draft.targets(f"{name}.v_dq"):
            draft.connect(TERMINAL_VOLTAGE, target)
        draft.remove(name)
    for name in draft.named("Rot_i"):
        for source in draft.sources(f"{name}.i_dq"):
            draft.connect(source, TERMINAL_CURRENT)
        draft.remove(name)


def _drive(draft: Draft, target: str, source: str) -> None:
    for other in draft.sources(target):
        draft.disconnect(other, target)
    draft.connect(source, target)
