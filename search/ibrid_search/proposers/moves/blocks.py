"""A block exchanged for another kind, or taken away."""

from collections.abc import Iterator
from itertools import combinations

from ibrid.structure.drafting import Draft
from ibrid_search.proposers.moves.drawing import frequency_sources
from ibrid_search.proposers.moves.family import Move, View
from ibrid_search.proposers.moves.shapers import STEMS

#: Kinds that take each other's place, by what they do.
_EXCHANGES = (
    ("PI", "Gain", "Integrator"),
    ("PI_dq", "Gain_dq"),
    ("LPF1", "Notch", "Pade1"),
    ("LPF1_dq", "Delay", "Pade1_dq"),
    ("Gain_dq", "LPF1_dq"),
    ("Gain", "LPF1"),
)

#: Exchanges that often pay: something that fits anything for something with a meaning.
USUAL_EXCHANGES = {
    ("Notch", "LPF1"): 2.0,
    ("Pade1", "LPF1"): 2.0,
    ("Pade1_dq", "LPF1_dq"): 2.0,
    ("Pade1_dq", "Delay"): 2.0,
    ("Gain_dq", "PI_dq"): 2.0,
    ("Gain", "PI"): 2.0,
    ("Integrator", "PI"): 2.0,
}


def exchange(view: View) -> Iterator[Move]:
    """Another kind of the same use in a block's place."""
    for name, one in view.draft.instances.items():
        for group in _EXCHANGES:
            for kind in view.known(*(other for other in group if one.kind in group and other != one.kind)):

                def swap(draft: Draft, name: str = name, kind: str = kind) -> None:
                    draft.replace(name, kind, f"{name}_{kind.lower()}" if name in STEMS.values() else name)

                usual = USUAL_EXCHANGES.get((one.kind, kind), 0.5)
                yield Move(f"{kind} in place of the {one.kind} {name}", swap, usual)


def coupling_frequency(view: View) -> Iterator[Move]:
    """A reactance that couples the axes, of a decoupling or a virtual impedance, at the measured frequency in place of the
    nominal one, or the other way round."""
    frequencies = frequency_sources(view.draft, view.roles)
    for name in (*view.draft.named("JMul"), *view.draft.named("JMul_omega")):
        kind = view.draft.instances[name].kind
        other = "JMul" if kind == "JMul_omega" else "JMul_omega"
        if not view.known(other) or (other == "JMul_omega" and not frequencies):
            continue

        def swap(draft: Draft, name: str = name, other: str = other) -> None:
            fresh = draft.replace(name, other, name)
            for source in frequencies if other == "JMul_omega" else ():
                draft.connect(source, f"{fresh}.delta_omega")

        yield Move(f"{other} in place of the {kind} {name}", swap)


def removals(view: View) -> Iterator[Move]:
    """One block less: a block in line is bypassed or its path cut, any other goes with its path."""
    for name in view.draft.instances:
        kind = view.draft.kind(name)
        if name == view.roles.plant or kind.name in ("ConstZero", "Rot_v", "Rot_i", "PackDQ"):
            continue
        if kind.in_line:
            yield Move(f"without the {kind.name} {name}", lambda draft, name=name: draft.bypass(name))
        yield Move(f"without the path through {name}", lambda draft, name=name: draft.remove(name))


def twin_removals(view: View) -> Iterator[Move]:
    """Two blocks that share their parameters go together, as they came."""
    for one, twin in combinations(view.draft.instances.values(), 2):
        kind = view.draft.kind(one.name)
        pairs = [
            (one.bindings.get(key, f"{one.name}.{key}"), twin.bindings.get(key, f"{twin.name}.{key}"))
            for key in kind.parameters
        ]
        if one.kind == twin.kind and kind.in_line and pairs and all(a == b for a, b in pairs):

            def change(draft: Draft, name: str = one.name, other: str = twin.name) -> None:
                draft.bypass(other)
                draft.bypass(name)

            yield Move(f"without the {one.kind}s {one.name} and {twin.name}", change)
