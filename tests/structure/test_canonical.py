"""The hash of a structure: blind to names and order of lines, sharp for everything else."""

from itertools import combinations

import networkx as nx
import numpy as np
import pytest
from collecting import each_of
from hypothesis import given, settings
from hypothesis import strategies as st
from random_diagrams import random_legal_diagram, renamed_and_reordered

from ibrid.errors import DiagramError
from ibrid.structure import (
    Diagram,
    canonical_order,
    parse_program,
    structure_hash,
    textbook,
    textbook_names,
    textbook_text,
)
from ibrid.structure.compiling.canonical_form import canonical_form

seeds = st.integers(0, 2**32 - 1)


@pytest.mark.slow
@settings(max_examples=150)
@given(seeds)
def test_renaming_and_reordering_keep_the_hash(seed):
    rng = np.random.default_rng(seed)
    diagram = random_legal_diagram(rng)
    assert structure_hash(renamed_and_reordered(diagram, rng)) == structure_hash(diagram)


@pytest.mark.slow
@settings(max_examples=100)
@given(seeds)
def test_modules_in_canonical_order_correspond(seed):
    rng = np.random.default_rng(seed)
    diagram = random_legal_diagram(rng)
    other = renamed_and_reordered(diagram, rng)
    kinds = [{one.name: one.kind for one in each.instances} for each in (diagram, other)]
    orders = canonical_order(diagram), canonical_order(other)
    assert sorted(orders[0]) == sorted(kinds[0])
    assert [kinds[0][name] for name in orders[0]] == [kinds[1][name] for name in orders[1]]


@pytest.mark.slow
@settings(max_examples=150)
@given(seeds)
def test_leaving_out_a_connection_changes_the_hash(seed):
    rng = np.random.default_rng(seed)
    diagram = random_legal_diagram(rng)
    skipped = int(rng.integers(len(diagram.connections)))
    other = Diagram()
    for one in diagram.instances:
        other.add(one.kind, one.name, **one.bindings)
    for index, one in enumerate(diagram.connections):
        if index != skipped:
            other.connect(one.source, one.target)
    assert structure_hash(other) != structure_hash(diagram)


def gfl(*changes: tuple[str, str]) -> str:
    text = textbook_text("gfl")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return structure_hash(parse_program(text))


@each_of(
    "change",
    [
        ('"q_loop", kP="power.kP"', '"q_loop"'),
        ('"q_loop", kP="power.kP", kI="power.kI"', '"q_loop", kP="power.kI", kI="power.kP"'),
        ('g.add("PI_dq", "current")', 'g.add("PI_dq", "current", kP=0.5)'),
        ('g.add("PI_dq", "current")', 'g.add("PI_dq", "current", kP=(0.1, 1))'),
        ('g.add("PI_dq", "current")', 'g.add("PI_dq", "current", kP="power.kP")'),
        ('g.connect("power.p", "minus_p.in_")', 'g.connect("power.q", "minus_p.in_")'),
        ('g.connect("plant.e", "plant.u_r")', 'g.connect("park_v.v_dq", "plant.u_r")'),
        ('g.add("Negate_dq", "minus_i")', 'g.add("Gain_dq", "minus_i")'),
    ],
)
def test_sharing_fixed_values_boxes_kinds_and_ports_change_the_hash(change):
    assert gfl(change) != gfl()


def test_fixed_values_and_boxes_enter_with_their_numbers():
    line = 'g.add("PI_dq", "current")'
    forms = ["kP=0.5", "kP=0.6", "kI=0.5", "kP=(0.1, 1)", "kP=(0.1, 2)"]
    hashes = [gfl((line, f'g.add("PI_dq", "current", {form})')) for form in forms]
    assert len(set(hashes)) == len(forms)


@pytest.mark.parametrize(
    "change",
    [
        ('g.add("PI_dq", "current")', 'g.add("PI_dq", "current", kP="anything")'),
        ('g.add("PI_dq", "current")', 'g.add("PI_dq", "current", kP=(1e-6, 1e5))'),
        ('kP="power.kP"', 'kP="k_p"'),
        ("power.kP", "p_loop.kP"),
        ('"LCL", "plant"', '"LCL", "plant", I0d="level"'),
        ("build_gfl", "another"),
    ],
)
def test_another_spelling_of_the_same_keeps_the_hash(change):
    assert gfl(change) == gfl()


def test_a_plus_and_a_minus_zero_are_the_same():
    line = 'g.add("PI_dq", "current")'
    assert gfl((line, 'g.add("PI_dq", "current", kP=0.0)')) == gfl(
        (line, 'g.add("PI_dq", "current", kP=-0.0)')
    )


def test_the_names_of_the_paper_are_shared_in_its_own_mode():
    text = textbook_text("gfl").replace('"Rot_i", "park_i"', '"Rot_i", "park_i", I0d="own"')
    other = parse_program(text)
    assert structure_hash(other) == structure_hash(textbook("gfl"))
    assert structure_hash(other, equilibrium="paper") != structure_hash(
        textbook("gfl"), equilibrium="paper"
    )


def test_identical_modules_may_be_exchanged_line_by_line():
    lines = [
        'g.add("LFilter", "plant")',
        'g.add("ConstZero", "z")',
        'g.connect("v_DQ", "plant.v_in")',
        'g.connect("z.out", "plant.delta_omega")',
        'g.connect("plant.i_g", "i_DQ")',
    ]
    for name in "abcdefgh":
        lines += [
            f'g.add("LPF1_dq", "{name}1")',
            f'g.add("Gain_dq", "{name}2")',
            f'g.connect("v_DQ", "{name}1.in_")',
            f'g.connect("{name}1.out", "{name}2.in_")',
            f'g.connect("{name}2.out", "plant.u_r")',
        ]
    text = "def f(g):\n" + "".join(f"    {line}\n" for line in lines)
    rng = np.random.default_rng(3)
    diagram = parse_program(text)
    hashes = {structure_hash(renamed_and_reordered(diagram, rng)) for _ in range(10)} | {
        structure_hash(diagram)
    }
    assert len(hashes) == 1
    crossed = text.replace('"a1.out", "a2.in_"', '"a1.out", "b2.in_"').replace(
        '"b1.out", "b2.in_"', '"b1.out", "a2.in_"'
    )
    assert structure_hash(parse_program(crossed)) in hashes
    joined = text.replace('"a1.out", "a2.in_"', '"b1.out", "a2.in_"')
    assert structure_hash(parse_program(joined)) not in hashes


def test_an_unknown_kind_or_port_is_refused():
    for line in (
        'g.add("Nothing", "x")',
        'g.connect("x.out", "plant.u_r")',
        'g.connect("v_DQ", "x.in_")',
    ):
        with pytest.raises(DiagramError):
            structure_hash(parse_program(textbook_text("naive") + f"    {line}\n"))


@each_of("name", textbook_names())
def test_a_hash_is_32_hexadecimal_digits(name):
    found = structure_hash(textbook(name))
    assert len(found) == 32
    assert int(found, 16) >= 0


# --- the labelling itself, against networkx ---


def graph(labels, edges) -> nx.MultiDiGraph:
    drawn = nx.MultiDiGraph()
    drawn.add_nodes_from((vertex, {"label": label}) for vertex, label in enumerate(labels))
    drawn.add_edges_from((start, end, {"label": label}) for start, end, label in edges)
    return drawn


def isomorphic(first, second) -> bool:
    def edges_match(one, other):
        return sorted(each["label"] for each in one.values()) == sorted(
            each["label"] for each in other.values()
        )

    return nx.is_isomorphic(
        graph(*first), graph(*second), lambda a, b: a["label"] == b["label"], edges_match
    )


def shuffled(labels, edges, rng):
    place = rng.permutation(len(labels))
    fresh = [""] * len(labels)
    for vertex, label in enumerate(labels):
        fresh[place[vertex]] = label
    moved = [(int(place[start]), int(place[end]), label) for start, end, label in edges]
    return fresh, [moved[index] for index in rng.permutation(len(moved))]


@pytest.mark.slow
def test_forms_of_random_graphs_agree_exactly_when_the_graphs_are_isomorphic():
    rng = np.random.default_rng(0)
    seen: dict[str, tuple] = {}
    for _ in range(600):
        size = int(rng.integers(1, 6))
        labels = [str(rng.choice(["a", "a", "b"])) for _ in range(size)]
        number = int(rng.integers(0, 2 * size))
        edges = sorted(
            {
                (*map(int, rng.integers(size, size=2)), str(rng.choice(["x", "x", "y"])))
                for _ in range(number)
            }
        )
        form = canonical_form(labels, edges)
        assert form.exact
        assert canonical_form(*shuffled(labels, edges, rng)).text == form.text
        if form.text in seen:
            assert isomorphic((labels, edges), seen[form.text])
        seen[form.text] = (labels, edges)
    alike: dict[tuple, list] = {}
    for labels, edges in seen.values():
        alike.setdefault((sorted(labels).count("a"), len(labels), len(edges)), []).append(
            (labels, edges)
        )
    for group in alike.values():
        for first, second in list(combinations(group, 2))[:15]:
            assert not isomorphic(first, second)


@pytest.mark.slow
@pytest.mark.parametrize(
    "drawn",
    [
        nx.petersen_graph(),
        nx.hypercube_graph(4),
        nx.complete_bipartite_graph(12, 12),
        nx.complete_graph(15),
        nx.grid_2d_graph(6, 6, periodic=True),
        nx.disjoint_union_all([nx.cycle_graph(5)] * 8),
        nx.random_regular_graph(3, 40, seed=1),
    ],
    ids=str,
)
def test_symmetric_graphs_have_an_exact_form_that_no_numbering_changes(drawn):
    numbered = nx.convert_node_labels_to_integers(drawn)
    edges = [(a, b, "x") for one in numbered.edges for a, b in (one, one[::-1])]
    labels = ["v"] * len(numbered)
    form = canonical_form(labels, edges)
    assert form.exact
    rng = np.random.default_rng(1)
    assert {canonical_form(*shuffled(labels, edges, rng)).text for _ in range(3)} == {form.text}
