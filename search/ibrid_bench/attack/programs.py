"""Programs that look legal and want all time and memory: loops, ladders, meshes, everything at its
bound.

Each maker fills a diagram with as much as the grammar admits of one idea, or just above it; where a
bound of the grammar is the point, both sides of it are there.
"""

from collections.abc import Callable, Mapping
from itertools import pairwise, product
from typing import Any

from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.grammar_rules.algebraic_loops import LARGEST_LOOP, TIGHTEST_LOOP
from ibrid.structure.grammar_rules.grammar import MOST_CONNECTIONS, MOST_FREE, MOST_MODULES

#: Modules that `_begun` has used.
_MODULES = 2
_MOST = MOST_MODULES - _MODULES
_FREE = MOST_FREE - 4
_CHORDS = TIGHTEST_LOOP - LARGEST_LOOP


def _begun(plant: str = "LFilter") -> Diagram:
    diagram = Diagram("evil")
    diagram.add(plant, "plant")
    diagram.add("ConstZero", "zero")
    diagram.connect("v_DQ", "plant.v_in")
    diagram.connect("zero.out", "plant.delta_omega")
    diagram.connect("plant.i_g", "i_DQ")
    return diagram


def _added(
    diagram: Diagram, number: int, kind: str = "Gain_dq", stem: str = "g", **bindings: Any
) -> list[str]:
    names = [f"{stem}{index}" for index in range(number)]
    for name in names:
        diagram.add(kind, name, **bindings)
    return names


def _joined(diagram: Diagram, pairs: list[tuple[str, str]]) -> None:
    """As many of the connections as the bound leaves room for."""
    for source, target in pairs[: MOST_CONNECTIONS - len(diagram.connections) - 1]:
        diagram.connect(f"{source}.out", f"{target}.in_")


def _driven(diagram: Diagram, first: list[str], last: list[str]) -> Diagram:
    for name in first:
        diagram.connect("v_DQ", f"{name}.in_")
    for name in last:
        diagram.connect(f"{name}.out", "plant.u_r")
    return diagram


def ring(number: int, chords: int = 0, kind: str = "Gain_dq", **bindings: Any) -> Diagram:
    """Modules in a loop of direct terms, with further connections among them."""
    diagram = _begun()
    names = _added(diagram, number, kind, **bindings)
    _driven(diagram, names[:1], names[:1])
    pairs = [
        (names[i], names[(i + step) % number]) for step in range(1, number) for i in range(number)
    ]
    _joined(diagram, pairs[: number + chords])
    return diagram


def ladder(number: int, chords: bool = True, **bindings: Any) -> Diagram:
    """Modules in a row, each driving the ones after it: the number of paths doubles with each."""
    diagram = _begun()
    names = _added(diagram, number, **bindings)
    _driven(diagram, names[:1], names[-1:])
    steps = range(1, number) if chords else range(1, 2)
    _joined(diagram, [(names[i], names[i + step]) for step in steps for i in range(number - step)])
    return diagram


def layers(width: int, depth: int, closed: bool = False, **bindings: Any) -> Diagram:
    """Layers in which all drive all of the next; closed: the last drives the first."""
    diagram = _begun()
    rows = [_added(diagram, width, stem=f"l{level}_", **bindings) for level in range(depth)]
    _driven(diagram, rows[0], rows[-1])
    both = [*pairwise(rows), *([(rows[-1], rows[0])] if closed else [])]
    _joined(diagram, [pair for before, after in both for pair in product(before, after)])
    return diagram


def rings(number: int, size: int, **bindings: Any) -> Diagram:
    """Many loops beside each other, all alike: symmetric in as many ways as there are orders."""
    diagram = _begun()
    for index in range(number):
        names = _added(diagram, size, stem=f"r{index}_", **bindings)
        _driven(diagram, names[:1], names[:1])
        _joined(diagram, [(names[i], names[(i + 1) % size]) for i in range(size)])
    return diagram


def mesh(states: int, gains: int, kind: str = "LPF1_dq", **bindings: Any) -> Diagram:
    """States that all reach all others through gains."""
    diagram = _begun()
    filters = _added(diagram, states, kind, stem="s")
    _driven(diagram, filters, filters)
    for index, name in enumerate(_added(diagram, gains, **bindings)):
        _joined(
            diagram, [(filters[index % states], name), (name, filters[index // states % states])]
        )
    return diagram


def beside(number: int, kind: str = "Gain_dq", **bindings: Any) -> Diagram:
    """As many equal paths beside each other as there may be: nothing tells them apart."""
    diagram = _begun()
    names = _added(diagram, number, kind, **bindings)
    for name in names:
        diagram.connect("plant.i_g", f"{name}.in_")
    return _driven(diagram, [], names)


def missing(connections: int) -> Diagram:
    """Connections between long names that nothing has; each would like a near one."""
    diagram = Diagram("evil")
    for index in range(MOST_MODULES):
        diagram.add("Gain_dq", f"gain_number_{index}_of_the_inner_current_controller_{index}")
    for index in range(connections):
        diagram.connect(
            f"gain_nunber_{index}_of_the_outer_controler.out",
            f"gain_namber_{index}_of_the_inner.in_",
        )
    return diagram


def powers(number: int) -> Diagram:
    """Products of signals, all of the same two."""
    diagram = _begun("LCL")
    for index in range(number):
        diagram.add("PQ_calc", f"c{index}")
        diagram.add("PackDQ", f"k{index}")
        for source, target in (
            ("plant.e", f"c{index}.e"),
            ("plant.i_g", f"c{index}.i"),
            (f"k{index}.out", "plant.u_r"),
        ):
            diagram.connect(source, target)
        diagram.connect(f"c{index}.p", f"k{index}.in_d")
        diagram.connect(f"c{index}.q", f"k{index}.in_q")
    return diagram


def turns(number: int) -> Diagram:
    """Rotations out of the controller's frame, one behind the other."""
    diagram = _begun("LCL")
    diagram.add("SRF_PLL", "pll")
    diagram.connect("plant.e_q", "pll.e_q")
    last = "plant.i_g"
    for index in range(number):
        diagram.add("Rot_v", f"r{index}")
        diagram.add("Rot_i", f"t{index}")
        diagram.connect("v_DQ", f"r{index}.v_DQ")
        diagram.connect(last, f"t{index}.i_dq")
        diagram.connect("pll.delta", f"r{index}.delta")
        diagram.connect("pll.delta", f"t{index}.delta")
        diagram.connect(f"r{index}.v_dq", "plant.u_r")
        last = f"t{index}.i_DQ"
    return diagram


#: What it is -> the diagram.
EVIL: Mapping[str, Callable[[], Diagram]] = {
    "195 gains in one algebraic loop": lambda: ring(195),
    "195 gains of one common parameter in a loop with 800 chords": lambda: ring(195, 800, k="k"),
    "195 gains of fixed size in a loop with 800 chords": lambda: ring(195, 800, k=0.3),
    "one module more in a loop than may be": lambda: ring(LARGEST_LOOP + 1),
    "a loop with one chord more than may be": lambda: ring(LARGEST_LOOP, _CHORDS + 1),
    "the largest algebraic loop": lambda: ring(LARGEST_LOOP, _CHORDS),
    "the largest algebraic loop, fixed gains": lambda: ring(LARGEST_LOOP, _CHORDS, k=0.3),
    "the largest loop of PI controllers": lambda: ring(14, TIGHTEST_LOOP - 14, "PI_dq"),
    "the largest loop of delays": lambda: ring(14, TIGHTEST_LOOP - 14, "Delay"),
    "198 negations in a loop": lambda: ring(_MOST, 800, "Negate_dq"),
    "many large loops, one parameter": lambda: rings(_MOST // LARGEST_LOOP, LARGEST_LOOP, k="k"),
    "66 small loops, all alike": lambda: rings(_MOST // 3, 3, k="k"),
    "one free parameter more than may be": lambda: ladder(_FREE + 3, False),
    "a ladder of 96 free gains, 1000 connections": lambda: ladder(_FREE),
    "a ladder of 198 fixed gains, 1000 connections": lambda: ladder(_MOST, k=0.5),
    "198 gains in a row": lambda: ladder(_MOST, False, k="k"),
    "layers of 8 gains, all to all": lambda: layers(8, 12),
    "layers of 8 fixed gains, 24 deep": lambda: layers(8, 15, k=0.1),
    "layers of 8 gains, closed to a loop": lambda: layers(8, 12, True),
    "two layers that feed each other": lambda: layers(5, 2, True),
    "14 filters that reach each other through 96 gains": lambda: mesh(14, _FREE - 14),
    "14 filters that reach each other through 180 gains": lambda: mesh(14, 180, k="k"),
    "13 PI controllers, all to all": lambda: mesh(13, _FREE - 26, "PI_dq"),
    "96 free gains beside each other": lambda: beside(_FREE),
    "198 fixed gains beside each other": lambda: beside(_MOST, k=0.01),
    "14 delays beside each other": lambda: beside(14, "Delay"),
    "99 products of the same signals": lambda: powers(_MOST // 2),
    "98 rotations in a row": lambda: turns(_MOST // 2 - 1),
    "1000 connections between modules that do not exist": lambda: missing(MOST_CONNECTIONS),
}
