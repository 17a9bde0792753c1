"""Rules for plants: one, or two devices behind one PCC that meet at the outer ports alone and
divide the power.
"""

from collections.abc import Mapping, Sequence

from ibrid.modules.kind import ModuleKind
from ibrid.structure.diagrams.diagram import (
    TERMINAL_CURRENT,
    TERMINAL_VOLTAGE,
    Connection,
    Instance,
)
from ibrid.structure.grammar_rules.violation import Violations
from ibrid.structure.reading.wiring import PLANT, connected_parts


def check_plants(
    instances: Sequence[Instance],
    connections: Sequence[Connection],
    kinds: Mapping[str, ModuleKind | None],
    vocabulary: Sequence[ModuleKind],
    findings: Violations,
) -> None:
    """Report a diagram without a plant, with plants that are not devices of their own, and shares
    that do not add up.
    """
    plants = [
        one for one in instances if (kind := kinds[one.name]) is not None and kind.family == PLANT
    ]
    shares = [one for one in instances if (kind := kinds[one.name]) is not None and kind.shares]
    available = " or ".join(kind.name for kind in vocabulary if kind.family == PLANT)
    if not plants and all(kinds.values()):
        findings.add(None, "no_plant", f"the diagram has no plant; add one {available}")
    part = connected_parts(kinds, [(one.source, one.target) for one in connections])
    dividing = " or ".join(kind.name for kind in vocabulary if kind.shares)
    for index, extra in enumerate(plants[1:], start=1):
        beside = next((one for one in plants[:index] if part[one.name] == part[extra.name]), None)
        if beside is not None or not dividing:
            other = (beside or plants[0]).name
            apart = (
                f", or let two devices meet at {TERMINAL_VOLTAGE} and {TERMINAL_CURRENT} alone"
                if dividing
                else ""
            )
            message = (
                f"{extra.name} ({extra.kind}) is a second plant beside {other}; keep exactly one "
                f"{available}{apart}"
            )
            findings.add(extra.line, "several_plants", message)
            return
    if plants:
        _check_shares(plants, shares, dividing, part, findings)
        _check_shares_in_place(connections, shares, findings)


def _check_shares(
    plants: Sequence[Instance],
    shares: Sequence[Instance],
    dividing: str,
    part: Mapping[str, int],
    findings: Violations,
) -> None:
    if len(plants) == 1 and shares:
        message = (
            f"{shares[0].name} ({shares[0].kind}) divides power between devices, but there is one "
            "plant; remove it"
        )
        findings.add(shares[0].line, "share", message)
        return
    holding = {part[one.name] for one in shares}
    without = [one for one in plants if part[one.name] not in holding]
    if len(plants) > 1 and (len(without) != 1 or len(shares) != len(plants) - 1):
        message = (
            f"{plants[-1].name} ({plants[-1].kind}) is a second plant beside {plants[0].name}; "
            "keep exactly one, or let "
            f"{TERMINAL_VOLTAGE} enter each device but one, which delivers the rest, through a "
            f"{dividing}: found {len(shares)}"
        )
        findings.add(plants[-1].line, "several_plants", message)


def _check_shares_in_place(
    connections: Sequence[Connection], shares: Sequence[Instance], findings: Violations
) -> None:
    for share in shares:
        entering = [each.source for each in connections if each.target == f"{share.name}.v_DQ"]
        if entering and entering != [TERMINAL_VOLTAGE]:
            message = (
                f"{share.name} ({share.kind}) takes the terminal voltage and nothing else; connect "
                f"{TERMINAL_VOLTAGE} to it"
            )
            findings.add(share.line, "share", message)
