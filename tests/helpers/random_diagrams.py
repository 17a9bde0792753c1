"""Random legal diagrams for tests: loops of direct terms, delays, rotations, shared names, fixed
numbers and boxes.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.signals import Signal
from ibrid.structure.compiling.check import violations
from ibrid.structure.diagrams.diagram import Binding, Diagram
from ibrid.structure.grammar_rules.grammar import HIGHEST_ORDER

#: Kinds that diagrams are drawn from unless told otherwise; further ones behind them change no
#: draw.
DRAWN_FROM = VOCABULARY[: [kind.name for kind in VOCABULARY].index("Share") + 1]
FRAME = ("Rot_v", "Rot_i", "SRF_PLL")


def random_legal_diagram(
    rng: np.random.Generator, vocabulary: Sequence[ModuleKind] = DRAWN_FROM, most_modules: int = 14
) -> Diagram:
    """A random diagram that `violations` accepts under `equilibrium="exact"`, with at most
    `most_modules` modules.
    """
    while True:
        diagram = _draw(rng, vocabulary, most_modules)
        if not violations(diagram, vocabulary):
            return diagram


def renamed_and_reordered(diagram: Diagram, rng: np.random.Generator) -> Diagram:
    """The same structure with other names of modules and of shared parameters, its lines in another
    order.
    """
    numbers = rng.permutation(len(diagram.instances))
    names = {one.name: f"m{number}" for one, number in zip(diagram.instances, numbers, strict=True)}
    shared: dict[str, str] = {}

    def renamed(value: Binding) -> Binding:
        if not isinstance(value, str):
            return value
        owner, _, parameter = value.partition(".")
        if owner in names and any(one.name == owner for one in diagram.instances) and parameter:
            return f"{names[owner]}.{parameter}"
        return shared.setdefault(value, f"s{len(shared)}")

    def port(end: str) -> str:
        name, dot, inner = end.partition(".")
        return f"{names[name]}.{inner}" if dot else end

    other = Diagram("other")
    for index in rng.permutation(len(diagram.instances)):
        one = diagram.instances[index]
        bindings = [(key, renamed(value)) for key, value in one.bindings.items()]
        rng.shuffle(bindings)
        other.add(one.kind, names[one.name], **dict(bindings))
    for index in rng.permutation(len(diagram.connections)):
        one = diagram.connections[index]
        other.connect(port(one.source), port(one.target))
    return other


def _draw(rng: np.random.Generator, vocabulary: Sequence[ModuleKind], most_modules: int) -> Diagram:
    known = {kind.name: kind for kind in vocabulary}
    plants = [kind.name for kind in vocabulary if kind.family == "physical plant"]
    chosen = [known[str(rng.choice(plants))]]
    framed = rng.random() < 0.6
    if framed:
        chosen += [known[name] for name in FRAME]
    others = [
        kind for kind in vocabulary if kind.name not in (*plants, *FRAME) and not kind.shares
    ]  # for two devices
    for _ in range(int(rng.integers(1, most_modules - len(chosen) + 1))):
        kind = others[int(rng.integers(len(others)))]
        if sum(one.order for one in chosen) + kind.order <= HIGHEST_ORDER:
            chosen.append(kind)
    diagram = Diagram("random")
    named = [
        ("plant" if number == 0 else f"{kind.name.lower()}_{number}", kind)
        for number, kind in enumerate(chosen)
    ]
    shared = {}
    for name, kind in named:
        diagram.add(kind.name, name, **_bindings(rng, kind, name, shared))
    _wire(diagram, rng, named, framed)
    return diagram


def _bindings(
    rng: np.random.Generator, kind: ModuleKind, instance: str, shared: dict[tuple[str, str], str]
) -> dict[str, Binding]:
    found: dict[str, Binding] = {}
    for name, box in kind.parameters.items():
        choice = rng.random()
        if choice < 0.15:
            found[name] = _near_typical(rng, box)
        elif choice < 0.25:
            found[name] = _narrower(box)
        elif choice < 0.45 and kind.family != "physical plant":
            if (kind.name, name) in shared:
                found[name] = shared[kind.name, name]
            else:  # another module may use this one's own name, or both a name of theirs
                own = rng.random() < 0.5
                shared[kind.name, name] = f"{instance}.{name}" if own else f"{kind.name}_{name}"
                if not own:
                    found[name] = shared[kind.name, name]
    return found


def _near_typical(rng: np.random.Generator, box: Range) -> float:
    if box.logarithmic:
        return float(np.clip(box.typical * 10 ** rng.uniform(-0.3, 0.3), box.low, box.high))
    return round(float(box.typical * rng.uniform(0.3, 0.9) * rng.choice([-1.0, 1.0])), 6)


def _narrower(box: Range) -> tuple[float, float]:
    if box.logarithmic:
        return max(box.low, box.typical / 3), min(box.high, box.typical * 3)
    return box.low / 50, box.high / 50


def _wire(
    diagram: Diagram,
    rng: np.random.Generator,
    named: Sequence[tuple[str, ModuleKind]],
    framed: bool,
) -> None:
    plant, plant_kind = named[0]
    outputs: dict[Signal, list[str]] = {signal: [] for signal in Signal}
    outputs[Signal.DQ_VEC].append("v_DQ")
    for name, kind in named:
        for port, signal in kind.outputs.items():
            outputs[signal].append(f"{name}.{port}")
    steady = [
        "v_DQ",
        *(f"{plant}.{port}" for port, one in plant_kind.outputs.items() if one is Signal.DQ_VEC),
    ]
    steady += [
        f"{name}.out" for name, kind in named if kind.name in ("LPF1_dq", "Negate_dq", "Delay")
    ]
    fixed = {f"{plant}.v_in": "v_DQ"}
    if framed:
        (rot_v, _), (rot_i, _), (pll, _) = named[1:4]
        fixed = {
            f"{plant}.v_in": f"{rot_v}.v_dq",
            f"{rot_v}.v_DQ": "v_DQ",
            f"{rot_v}.delta": f"{pll}.delta",
            f"{rot_i}.i_dq": f"{plant}.i_g",
            f"{rot_i}.delta": f"{pll}.delta",
            f"{pll}.e_q": f"{plant}.e_q",
        }
        diagram.connect(f"{rot_i}.i_DQ", "i_DQ")
    else:
        diagram.connect(f"{plant}.i_g", "i_DQ")
    for name, kind in named:
        for port, signal in kind.inputs.items():
            target = f"{name}.{port}"
            if target in fixed:
                diagram.connect(fixed[target], target)
                continue
            needs = kind.family != "physical plant" and port in kind.equilibrium_ports
            pool = steady if needs else outputs[signal]
            number = min(len(pool), 1 + int(rng.random() < 0.4) + int(rng.random() < 0.1))
            for index in rng.choice(len(pool), size=number, replace=False):
                diagram.connect(pool[index], target)
