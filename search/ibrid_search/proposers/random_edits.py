"""The baseline: legal edits drawn by chance, without any idea of what an inverter is."""

import numpy as np

from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.wiring import split_port
from ibrid_search.proposal import Context, Proposal, Proposer

#: Drawn edits before the proposer gives up for this parent.
TRIES = 200


class RandomEdits(Proposer):
    """Draws edits until one leads to a legal, plausible structure that the run has not met.

    local: a wire moved, added or cut, two parameters shared or freed. module: a module put in,
    taken out or exchanged. structural: the plant exchanged, or two to four module edits at once.
    """

    name = "random"

    def propose(self, context: Context, rng: np.random.Generator) -> Proposal:
        """A random edit of the parent of the scale that the context asks for."""
        parent = context.parent.diagram
        for _ in range(TRIES):
            draft = Draft(parent, context.study.kinds)
            notes = _change(draft, context.scale, rng)
            if not notes:
                continue
            draft.tidy()
            diagram = draft.diagram()
            if context.is_new(diagram):
                return Proposal.between(parent, diagram, "; ".join(notes))
        return Proposal("", failure=f"{TRIES} random edits led to no new legal structure")


def _change(draft: Draft, scale: str, rng: np.random.Generator) -> list[str]:
    """Make an edit; what was done, [] when there was no place for it."""
    if scale == "local":
        edits = [_one(rng, (_move_wire, _add_wire, _cut_wire, _share))]
    elif scale == "module":
        edits = [_one(rng, (_insert, _remove, _exchange))]
    elif rng.random() < 0.3:
        edits = [_other_plant]
    else:
        edits = [_one(rng, (_insert, _remove, _exchange)) for _ in range(int(rng.integers(2, 5)))]
    return [note for edit in edits if (note := edit(draft, rng))]


def _one(rng: np.random.Generator, options):
    return options[int(rng.integers(len(options)))]


def _plants(draft: Draft) -> list[str]:
    return [name for name in draft.instances if "u_r" in draft.kind(name).inputs]


def _move_wire(draft: Draft, rng: np.random.Generator) -> str:
    source, target = _one(rng, draft.wires)
    other = _one(rng, draft.outputs(draft.signal(source)))
    draft.disconnect(source, target)
    draft.connect(other, target)
    return f"{other} instead of {source} at {target}"


def _add_wire(draft: Draft, rng: np.random.Generator) -> str:
    _, target = _one(rng, draft.wires)
    source = _one(
        rng, draft.outputs(Signal.DQ_VEC if target == TERMINAL_CURRENT else draft.signal(target))
    )
    draft.connect(source, target)
    return f"{source} added to {target}"


def _cut_wire(draft: Draft, rng: np.random.Generator) -> str:
    sums = [wire for wire in draft.wires if len(draft.sources(wire[1])) > 1]
    if not sums:
        return ""
    source, target = _one(rng, sums)
    draft.disconnect(source, target)
    return f"no {source} at {target}"


def _share(draft: Draft, rng: np.random.Generator) -> str:
    able = [name for name in draft.instances if draft.kind(name).parameters]
    if not able:
        return ""
    name = _one(rng, able)
    shared = [
        key for key, value in draft.instances[name].bindings.items() if isinstance(value, str)
    ]
    if shared:
        draft.unbind(name, *shared)
        return f"parameters of its own for {name}"
    alike = [
        one
        for one in able
        if one != name and draft.instances[one].kind == draft.instances[name].kind
    ]
    if not alike:
        return ""
    other = _one(rng, alike)
    draft.bind(other, **{key: f"{name}.{key}" for key in draft.kind(name).parameters})
    return f"the same parameters for {name} and {other}"


def _insert(draft: Draft, rng: np.random.Generator) -> str:
    """A module on a wire when it has an input and an output that fit, else wired at random.

    Of any kind but a plant and what divides power between devices.
    """
    kind = _one(
        rng,
        [one for one in draft.vocabulary.values() if "u_r" not in one.inputs and not one.shares],
    )
    name = draft.add(kind.name, kind.name.lower())
    for port, signal in kind.inputs.items():
        options = [one for one in draft.outputs(signal) if split_port(one)[0] != name]
        if not options:
            return ""
        draft.connect(_one(rng, options), f"{name}.{port}")
    for port, signal in kind.outputs.items():
        targets = [
            target
            for source, target in draft.wires
            if split_port(target)[0] != name and draft.signal(source) is signal
        ]
        if targets:
            target = _one(rng, targets)
            if rng.random() < 0.5:
                if kind.in_line:
                    draft.gather(f"{name}.in_", *draft.sources(target))
                draft.drive(target)
            draft.connect(f"{name}.{port}", target)
    return f"a {kind.name} put in"


def _beside_the_plant(draft: Draft, rng: np.random.Generator) -> str | None:
    names = [name for name in draft.instances if name not in _plants(draft)]
    return _one(rng, names) if names else None


def _remove(draft: Draft, rng: np.random.Generator) -> str:
    if (name := _beside_the_plant(draft, rng)) is None:
        return ""
    kind = draft.kind(name)
    if kind.in_line and rng.random() < 0.7:
        draft.bypass(name)
    else:
        draft.remove(name)
    return f"without the {kind.name} {name}"


def _exchange(draft: Draft, rng: np.random.Generator) -> str:
    if (name := _beside_the_plant(draft, rng)) is None:
        return ""
    kind = draft.kind(name)
    same = [
        one.name
        for one in draft.vocabulary.values()
        if one.name != kind.name and one.inputs == kind.inputs and one.outputs == kind.outputs
    ]
    if not same:
        return ""
    other = _one(rng, same)
    draft.replace(name, other, other.lower())
    return f"{other} in place of the {kind.name} {name}"


def _other_plant(draft: Draft, rng: np.random.Generator) -> str:
    (plant,) = _plants(draft)[:1]
    others = [
        one
        for one in draft.vocabulary.values()
        if "u_r" in one.inputs and one.name != draft.kind(plant).name
    ]
    if not others:
        return ""
    other = _one(rng, others)
    for port in draft.kind(plant).outputs:
        for target in draft.targets(f"{plant}.{port}") if port not in other.outputs else []:
            draft.connect(f"{plant}.i_g", target)
    draft.replace(plant, other.name, "plant")
    return f"{other.name} as the plant"
