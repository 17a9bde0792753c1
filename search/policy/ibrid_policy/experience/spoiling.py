"""One random slip in a diagram: a wire too many, too few or elsewhere, a sign, a block too many or
too few, a wrong kind.
"""

import numpy as np

from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT
from ibrid.structure.editing.drafting import Draft
from ibrid_policy.edit import exchangeable, is_plant


def make_slip(draft: Draft, rng: np.random.Generator) -> None:
    """Change a draft in one random way, or not at all where there is no place for it."""
    slips = (_elsewhere, _too_many, _too_few, _turned, _inserted, _left_out, _other_kind, _shared)
    slips[int(rng.choice(len(slips), p=[0.14, 0.14, 0.1, 0.08, 0.24, 0.1, 0.14, 0.06]))](draft, rng)


def _elsewhere(draft: Draft, rng: np.random.Generator) -> None:
    source, target = _one(rng, draft.wires)
    draft.connect(_one(rng, draft.outputs(draft.signal(source))), target)
    draft.disconnect(source, target)


def _too_many(draft: Draft, rng: np.random.Generator) -> None:
    _, target = _one(rng, draft.wires)
    signal = Signal.DQ_VEC if target == TERMINAL_CURRENT else draft.signal(target)
    draft.connect(_one(rng, draft.outputs(signal)), target)


def _too_few(draft: Draft, rng: np.random.Generator) -> None:
    sums = [wire for wire in draft.wires if len(draft.sources(wire[1])) > 1]
    if sums:
        draft.disconnect(*_one(rng, sums))


def _turned(draft: Draft, rng: np.random.Generator) -> None:
    source, target = _one(rng, draft.wires)
    if target != TERMINAL_CURRENT:
        draft.disconnect(source, target)
        draft.connect(draft.negated(source), target)


def _inserted(draft: Draft, rng: np.random.Generator) -> None:
    """A block of one input and one output in a wire, or beside it."""
    source, target = _one(rng, draft.wires)
    signal = draft.signal(source)
    kinds = [
        kind
        for kind in draft.vocabulary.values()
        if list(kind.inputs.values()) == [signal] == list(kind.outputs.values()) and not kind.shares
    ]
    if not kinds:
        return
    kind = _one(rng, kinds)
    name = draft.add(kind.name, kind.name.lower())
    draft.connect(source, f"{name}.{next(iter(kind.inputs))}")
    draft.connect(f"{name}.{next(iter(kind.outputs))}", target)
    if rng.random() < 0.7:
        draft.disconnect(source, target)


def _left_out(draft: Draft, rng: np.random.Generator) -> None:
    names = [name for name in draft.instances if not is_plant(draft.kind(name))]
    name = _one(rng, names)
    if (
        list(draft.kind(name).inputs) == ["in_"]
        and "out" in draft.kind(name).outputs
        and rng.random() < 0.7
    ):
        draft.bypass(name)
    else:
        draft.remove(name)


def _other_kind(draft: Draft, rng: np.random.Generator) -> None:
    name = _one(rng, list(draft.instances))
    others = [
        kind.name for kind in draft.vocabulary.values() if exchangeable(draft.kind(name), kind)
    ]
    if others and (not is_plant(draft.kind(name)) or rng.random() < 0.3):
        draft.rename(draft.replace(name, _one(rng, others), "other_kind"), name)


def _shared(draft: Draft, rng: np.random.Generator) -> None:
    able = [name for name in draft.instances if draft.kind(name).parameters]
    if len(able) < 2:
        return
    one, other = (able[index] for index in rng.choice(len(able), 2, replace=False))
    if draft.instances[other].bindings:
        draft.unbind(other, *draft.instances[other].bindings)
    elif draft.instances[one].kind == draft.instances[other].kind:
        draft.bind(other, **{key: f"{one}.{key}" for key in draft.kind(one).parameters})


def _one(rng: np.random.Generator, options):
    return options[int(rng.integers(len(options)))]
