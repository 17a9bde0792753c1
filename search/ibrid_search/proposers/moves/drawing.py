"""What several edits draw in common: where a path joins, a block behind a source, one axis of a dq input."""

from ibrid.structure.drafting import Draft
from ibrid.structure.roles import Roles
from ibrid.structure.wiring import split_port


def summing(draft: Draft, target: str) -> str:
    """Where a new path joins: in front of a delay of the whole command, since that delays whatever is computed."""
    sources = draft.sources(target)
    if len(sources) == 1:
        name = split_port(sources[0])[0]
        if name and draft.instances[name].kind in ("Delay", "Pade1_dq"):
            return f"{name}.in_"
    return target


def after(draft: Draft, source: str, kind: str, stem: str) -> str:
    """The output of a new block behind a source."""
    name = draft.add(kind, stem)
    draft.connect(source, f"{name}.in_")
    return f"{name}.out"


def power_module(draft: Draft, roles: Roles) -> str:
    """The module that computes p and q from the filter's voltage and the grid current; a new one if there is none."""
    if roles.power and roles.power[0] in draft.instances:
        return roles.power[0]
    found = draft.named("PQ_calc")
    name = found[0] if found else draft.add("PQ_calc", "power")
    draft.chain(roles.voltage, f"{name}.e", f"{roles.plant}.i_g", f"{name}.i")
    return name


def to_axis(draft: Draft, source: str, target: str, axis: str) -> None:
    """Let a scalar drive one axis of a dq input, in place of what drove that axis before."""
    packs = [split_port(one)[0] for one in draft.sources(target)]
    packs = [name for name in packs if name and draft.instances[name].kind == "PackDQ"]
    pack = packs[0] if packs else draft.add("PackDQ", "reference")
    for old in draft.sources(f"{pack}.{axis}"):
        draft.disconnect(old, f"{pack}.{axis}")
    draft.connect(source, f"{pack}.{axis}")
    draft.connect(f"{pack}.out", target)


def frequency_sources(draft: Draft, roles: Roles) -> list[str]:
    """What makes the frequency of the controller's frame: all that adds up at the plant, but for zeros."""
    sources = draft.sources(f"{roles.plant}.delta_omega")
    return [one for one in sources if draft.instances[split_port(one)[0]].kind != "ConstZero"]
