"""The rules propose what an engineer would: one sub-loop at a time, by where the error lies, and
nothing looked up.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.search.inverters import DIAGRAMS, inverter
from ibrid_search.edits import apply_edit
from ibrid_search.evaluated import SCALES
from ibrid_search.proposal import Proposal
from ibrid_search.proposers.rules import CURIOSITY, FAMILIES, LATER, Rules, residual_bands
from ibrid_search.screening.plausibility import refusal_reason
from ibrid_search.screening.settings import SCREENING
from scripted_search import context_of, record_of, study
from sharing import shared

import ibrid
from ibrid.fit.objective import BAND_NAMES
from ibrid.modules.kind import ModuleKind, Range
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY, Vocabulary
from ibrid.parts import Family, Move, view_of, views_of
from ibrid.signals import Signal
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.editing.roles import Roles

SEARCH = Path(__file__).resolve().parents[2] / "search" / "ibrid_search"
#: An engineer's edit is no larger than this: a droop with its rotations has eight blocks.
MOST_ADDED = 8

TEXTBOOK = {name: ibrid.textbook(name) for name in ibrid.textbook_names()}
NAIVE = TEXTBOOK["naive"]
#: The hidden ones too: what the rules meet on their way looks like these.
PARENTS = TEXTBOOK | {
    name: truth for name in DIAGRAMS if (truth := inverter(name).truth) is not None
}


def moves_of(
    diagram: ibrid.Diagram, kinds: Vocabulary = VOCABULARY
) -> Iterator[tuple[str, Move, ibrid.Diagram]]:
    """Family, move and what comes out, of all that the rules list, for each device."""
    views = views_of(diagram, kinds)
    assert views
    for view in views:
        for family in FAMILIES:
            for move in family.moves(view):
                yield family.name, move, view.after(move)


@shared
def legal_moves(name: str) -> tuple[tuple[str, Move, ibrid.Diagram], ...]:
    """Those that the rules may propose for one of the parents."""
    found = []
    for family, move, diagram in moves_of(PARENTS[name]):
        violations, warnings = ibrid.structure.compiling.check.examine(diagram, VOCABULARY)
        if not violations and not refusal_reason(warnings):
            found.append((family, move, diagram))
    return tuple(found)


def hash_of(diagram: ibrid.Diagram, kinds: Vocabulary = VOCABULARY) -> str:
    return structure_hash(diagram, kinds)


def proposed(diagram: ibrid.Diagram, seed: int, **changes) -> Proposal:
    return Rules(looks=1).propose(context_of(diagram, **changes), np.random.default_rng(seed))


def after(proposal: Proposal, parent: ibrid.Diagram) -> ibrid.Diagram:
    assert proposal.failure == ""
    return ibrid.parse_program(apply_edit(proposal.edit, ibrid.program_text(parent)))


# the moves


@pytest.mark.nightly
@each_of("name", PARENTS)
def test_every_move_is_made_and_most_lead_to_a_legal_diagram(name):
    listed = list(moves_of(PARENTS[name]))
    assert len(listed) >= 30
    assert len(legal_moves(name)) >= 0.9 * len(listed)


@pytest.mark.nightly
@each_of("name", PARENTS)
def test_a_move_says_what_it_does_in_a_line(name):
    for _, move, _ in legal_moves(name):
        assert 0 < len(move.note) < 120
        assert move.note.isprintable()


@pytest.mark.slow
@each_of("name", PARENTS)
def test_a_move_leaves_its_parent_as_it_is(name):
    before = ibrid.program_text(PARENTS[name])
    list(moves_of(PARENTS[name]))
    assert ibrid.program_text(PARENTS[name]) == before


@pytest.mark.nightly
@each_of("name", PARENTS)
def test_no_move_adds_more_than_a_sub_loop(name):
    before = {one.name for one in PARENTS[name].instances}
    for _, move, diagram in legal_moves(name):
        assert len({one.name for one in diagram.instances} - before) <= MOST_ADDED, move.note


def roles_of(diagram: ibrid.Diagram) -> tuple[Roles, ...]:
    """Those of each device."""
    return tuple(view.roles for view in views_of(diagram, VOCABULARY))


def layers(found: Roles) -> set[str]:
    """The sub-loops that an engineer names."""
    present = {
        "LCL filter": found.lcl,
        "synchronisation": found.frequency is not None,
        "current loop": found.current_loop is not None,
        "voltage loop": found.voltage_loop is not None,
        "outer loops": bool(found.outer),
    }
    return {name for name, there in present.items() if there}


@pytest.mark.nightly
@each_of("name", PARENTS)
def test_no_move_brings_two_layers_of_a_controller(name):
    before = roles_of(PARENTS[name])
    for _, move, diagram in legal_moves(name):
        # a device that is put in has none yet, one that is taken away takes its own along
        pairs = zip(before, roles_of(diagram), strict=False)
        assert sum(len(layers(after) - layers(one)) for one, after in pairs) <= 1, move.note


@pytest.mark.nightly
def test_no_single_move_leads_from_the_naive_start_to_a_textbook_program():
    others = [diagram for name, diagram in TEXTBOOK.items() if name != "naive"]
    for _, move, diagram in legal_moves("naive"):
        assert not any(ibrid.compare(diagram, other).same for other in others), move.note


def test_every_layer_can_be_had_from_the_naive_start():
    (before,) = roles_of(NAIVE)
    gained: set[str] = set()
    for _, _, diagram in legal_moves("naive"):
        gained |= layers(roles_of(diagram)[0]) - layers(before)
    # a voltage loop needs the voltage of a capacitor, so the LCL comes first
    assert gained == {"LCL filter", "synchronisation", "current loop", "outer loops"}


@pytest.mark.slow
@pytest.mark.parametrize("scale", SCALES)
def test_every_scale_has_moves_for_a_controller(scale):
    names = {family.name for family in FAMILIES if family.scale == scale}
    assert {family for family, _, _ in legal_moves("gfl")} & names


def test_families_are_well_formed():
    for family in FAMILIES:
        assert family.scale in SCALES
        assert len(family.bands) == len(BAND_NAMES)
        assert all(0 <= share <= 1 for share in family.bands)
        assert family.weight > 0
    assert len({family.name for family in FAMILIES}) == len(FAMILIES)


# the textbook's single steps, each of which must be there


def is_one_move(before: ibrid.Diagram, after: ibrid.Diagram) -> bool:
    return hash_of(after) in {hash_of(diagram) for _, _, diagram in moves_of(before)}


def put(change) -> ibrid.Diagram:
    draft = Draft(TEXTBOOK["gfl"], VOCABULARY)
    change(draft)
    return draft.diagram()


@pytest.mark.slow
@each_of(
    "change",
    [
        lambda d: d.insert_before("pll.e_q", "LPF1", "x"),
        lambda d: d.insert_before("plant.u_r", "Delay", "x"),
        lambda d: d.insert("plant.i_ti", d.targets("plant.i_ti"), "LPF1_dq", "x"),
        lambda d: d.insert("plant.e", ["plant.u_r"], "LPF1_dq", "x"),
        lambda d: d.disconnect("plant.e", "plant.u_r"),
        lambda d: d.remove("decoupling"),
        lambda d: [d.unbind(name, "kP", "kI") for name in ("p_loop", "q_loop")],
        lambda d: d.chain("plant.i_C", f"{d.add('Gain_dq', 'x')}.in_", "x.out", "plant.u_r"),
    ],
    ids=[
        "PLL filter",
        "delay",
        "current filter",
        "feedforward filter",
        "no feedforward",
        "no decoupling",
        "own gains",
        "active damping",
    ],
)
def test_a_textbook_variation_is_one_move_away(change):
    assert is_one_move(TEXTBOOK["gfl"], put(change))


@pytest.mark.nightly
def test_a_droop_becomes_a_machine_that_a_pll_damps_by_one_move():
    draft = Draft(TEXTBOOK["gfm_droop"], VOCABULARY)
    pll, damping = draft.add("PLL_frequency", "pll_frequency"), draft.add("Gain", "pll_damping")
    draft.chain(
        "plant.e",
        f"{pll}.v",
        f"{pll}.delta_omega_pll",
        f"{damping}.in_",
        f"{damping}.out",
        "p_filter.in_",
    )
    draft.connect("p_droop.out", f"{pll}.delta_omega")
    machine = (
        draft.diagram()
    )  # its gain of the power lies behind the low-pass, that of gfm_vsm before it
    assert is_one_move(TEXTBOOK["gfm_droop"], machine)
    record = ibrid.evaluate(machine, inverter("gfm_vsm").sweep)
    assert record.nrmse < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        lambda d: (
            d.disconnect("plant.e", "plant.u_r"),
            d.connect(d.negated("plant.e"), "plant.u_r"),
        ),
        lambda d: (
            d.disconnect("plant.i_ti", "minus_i.in_"),
            d.connect("plant.i_g", "minus_i.in_"),
        ),
        lambda d: (
            d.disconnect("decoupling.out", "plant.u_r"),
            d.connect("decoupling.out", "current.in_"),
        ),
    ],
    ids=["sign", "measured signal", "injection point"],
)
def test_a_wiring_slip_is_one_move_away(change):
    assert is_one_move(TEXTBOOK["gfl"], put(change))


# what comes first

FILTERED = Move("a filter", lambda draft: draft.insert_before("plant.u_r", "LPF1_dq", "x"))
DELAYED = Move("a delay", lambda draft: draft.insert_before("plant.u_r", "Delay", "x"))
ALIKE = (1.0, 1.0, 1.0, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("weight", [1.0, 3.0])
def test_while_a_part_is_missing_what_puts_it_in_comes_before_the_rest(weight):
    families = (
        Family("missing", "module", ALIKE, weight, lambda _: iter([FILTERED]), first=True),
        Family("other", "module", ALIKE, 1.0, lambda _: iter([DELAYED])),
    )
    context, rules = context_of(NAIVE), Rules(families, looks=1)
    notes = [rules.propose(context, np.random.default_rng(seed)).note for seed in range(1000)]
    expected = CURIOSITY / 2 + (1 - CURIOSITY) * weight / (weight + LATER)
    # a thousand draws: four standard deviations are 0.05
    assert notes.count("a filter") / 1000 == pytest.approx(expected, abs=0.05)


@pytest.mark.slow
def test_what_need_not_wait_is_tried_beside_what_comes_first():
    families = (
        Family("missing", "module", ALIKE, 1.0, lambda _: iter([FILTERED]), first=True),
        Family("patient", "module", ALIKE, 1.0, lambda _: iter([DELAYED]), any_time=True),
    )
    context, rules = context_of(NAIVE), Rules(families, looks=1)
    notes = [rules.propose(context, np.random.default_rng(seed)).note for seed in range(1000)]
    assert notes.count("a delay") / 1000 == pytest.approx(
        0.5, abs=0.065
    )  # four standard deviations


@pytest.mark.slow
@pytest.mark.parametrize(
    ("nrmse", "noise", "weight"),
    [
        (0.5, None, 4.0),
        (None, None, 4.0),
        (0.9 * SCREENING.gross_error, None, 1.0),
        (0.5, 0.3, 1.0),
    ],
)
def test_while_the_error_is_gross_another_structure_is_tried_more_readily(nrmse, noise, weight):
    families = (
        Family("detail", "module", ALIKE, 1.0, lambda _: iter([FILTERED])),
        Family("structure", "module", ALIKE, 1.0, lambda _: iter([DELAYED]), if_gross=4.0),
    )
    record = replace(record_of(ibrid.program_text(NAIVE)), nrmse=nrmse, noise_floor=noise)
    context, rules = context_of(NAIVE, record=record), Rules(families, looks=1)
    notes = [rules.propose(context, np.random.default_rng(seed)).note for seed in range(1000)]
    expected = CURIOSITY / 2 + (1 - CURIOSITY) * weight / (weight + 1)
    assert notes.count("a delay") / 1000 == pytest.approx(expected, abs=0.05)


def test_what_comes_first_gives_way_when_nothing_of_it_is_new():
    families = (
        Family("missing", "module", ALIKE, 1.0, lambda _: iter([FILTERED]), first=True),
        Family("other", "module", ALIKE, 1.0, lambda _: iter([DELAYED])),
    )
    view = view_of(NAIVE, VOCABULARY)
    assert view is not None
    context = context_of(NAIVE, seen={hash_of(view.after(FILTERED))}.__contains__)
    assert {
        Rules(families, looks=1).propose(context, np.random.default_rng(seed)).note
        for seed in range(20)
    } == {"a delay"}


@each_of("name", PARENTS)
def test_families_come_first_as_long_as_a_layer_is_missing(name):
    for view in views_of(PARENTS[name], VOCABULARY):
        assert any(any(family.moves(view)) for family in FAMILIES if family.first) == (
            view.roles.missing_layers > 0
        )


def test_every_layer_that_may_be_missing_has_a_family_that_comes_first():
    names = {family.name for family in FAMILIES if family.first}
    assert names == {"synchronisation", "capacitor", "current loop", "voltage loop", "power loops"}


# the other axis, the other current


def edits_of(family: str, diagram: ibrid.Diagram) -> dict[str, ibrid.Diagram]:
    """What comes out of each move of a family, by its note."""
    return {move.note: after for name, move, after in moves_of(diagram) if name == family}


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "twin"), [("p_loop", "q_loop"), ("q_loop", "p_loop")])
def test_an_axis_without_an_outer_loop_gets_one_with_gains_of_its_own_or_those_of_the_other(
    axis, twin
):
    gains = {"kP": "power.kP", "kI": "power.kI"}
    found = edits_of("missing axis", put(lambda draft: draft.remove(axis)))
    what = axis[0]
    own = put(lambda draft: draft.unbind(axis, *gains))
    assert hash_of(found[f"PI control of {what} with the gains of {twin}"]) == hash_of(
        TEXTBOOK["gfl"]
    )
    assert hash_of(found[f"PI control of {what} too"]) == hash_of(own)
    assert all(ibrid.violations(diagram) == () for diagram in found.values())


def test_the_voltage_magnitude_may_take_the_q_axis_and_never_the_d_axis():
    for axis, there in (("q_loop", True), ("p_loop", False)):
        found = edits_of("missing axis", put(lambda draft, axis=axis: draft.remove(axis)))
        assert any("voltage magnitude" in note for note in found) == there


@pytest.mark.parametrize("name", ["naive", "gfl", "gfl_l_filter"])
def test_no_axis_is_missing_where_both_or_none_have_a_loop(name):
    assert edits_of("missing axis", TEXTBOOK[name]) == {}


@pytest.mark.slow
def test_the_current_loop_may_measure_the_other_current_alone_or_with_the_whole_controller():
    alone = put(
        lambda d: (d.disconnect("plant.i_ti", "minus_i.in_"), d.connect("plant.i_g", "minus_i.in_"))
    )
    whole = Draft(alone, VOCABULARY)
    whole.disconnect("plant.i_ti", "decoupling.in_")
    whole.connect("plant.i_g", "decoupling.in_")
    both = whole.diagram()
    found = {hash_of(diagram) for diagram in edits_of("other current", TEXTBOOK["gfl"]).values()}
    assert {hash_of(alone), hash_of(both)} <= found
    for parent in (alone, both):
        assert hash_of(TEXTBOOK["gfl"]) in {
            hash_of(after) for after in edits_of("other current", parent).values()
        }


@pytest.mark.slow
@pytest.mark.parametrize(("parent", "child"), [("gfl", "gfl_exact"), ("gfl_exact", "gfl")])
def test_a_coupling_at_the_nominal_frequency_and_one_at_the_measured_are_one_move_apart(
    parent, child
):
    changed = [
        diagram for family, _, diagram in legal_moves(parent) if family == "frequency of a coupling"
    ]
    assert [hash_of(diagram) for diagram in changed] == [hash_of(TEXTBOOK[child])]


def test_nothing_measures_the_frequency_without_synchronisation():
    draft = Draft(NAIVE, VOCABULARY)
    name = draft.add("JMul", "coupling")
    draft.chain("plant.i_g", f"{name}.in_", f"{name}.out", "plant.u_r")
    assert not [
        family for family, _, _ in moves_of(draft.diagram()) if family == "frequency of a coupling"
    ]


def test_powers_and_the_terminal_keep_the_grid_current():
    for diagram in edits_of("other current", TEXTBOOK["gfl"]).values():
        draft = Draft(diagram, VOCABULARY)
        assert draft.sources("power.i") == draft.sources("park_i.i_dq") == ["plant.i_g"]


@pytest.mark.parametrize("name", ["naive", "gfl_l_filter"])
def test_without_a_current_loop_or_an_lcl_there_is_no_other_current(name):
    assert edits_of("other current", TEXTBOOK[name]) == {}


# the proposals


@pytest.mark.slow
@each_of("name", ["naive", "gfl_exact", "gfl_l_filter_delay"])
@each_of("scale", SCALES)
def test_a_proposal_is_a_legal_structure_that_the_run_has_not_met(name, scale):
    parent = TEXTBOOK[name]
    seen = {hash_of(parent)}
    for seed in range(12):
        found = after(proposed(parent, seed, scale=scale, seen=seen.__contains__), parent)
        assert ibrid.violations(found) == ()
        assert hash_of(found) not in seen
        seen.add(hash_of(found))


def test_the_same_random_numbers_give_the_same_proposal():
    for seed in range(5):
        assert proposed(NAIVE, seed) == proposed(NAIVE, seed)
    assert len({proposed(NAIVE, seed).edit for seed in range(12)}) > 3


def test_a_scale_that_is_exhausted_gives_way_to_the_others():
    known = {family.name: family.scale for family in FAMILIES}
    local = {
        hash_of(diagram) for family, _, diagram in legal_moves("naive") if known[family] == "local"
    }
    proposal = proposed(NAIVE, 0, scale="local", seen=(local | {hash_of(NAIVE)}).__contains__)
    assert hash_of(after(proposal, NAIVE)) not in local


def test_when_everything_is_known_the_rules_say_so():
    proposal = proposed(NAIVE, 0, seen=lambda _: True)
    assert proposal.edit == ""
    assert "met before" in proposal.failure


def test_a_diagram_without_a_plant_is_answered_in_a_sentence():
    proposal = Rules().propose(
        context_of(ibrid.Diagram(), record=record_of(ibrid.program_text(NAIVE))),
        np.random.default_rng(),
    )
    assert proposal.edit == ""
    assert "LCL or LFilter" in proposal.failure


# where the error lies


def erring(*shares: float):
    """The naive record with these shares of the error in the four bands."""
    table = dict(zip(BAND_NAMES, shares, strict=True))
    return replace(record_of(ibrid.program_text(NAIVE)), share_by_band=table, nrmse_by_band=table)


def families_proposed(
    diagram: ibrid.Diagram, name: str, record, scale: str, number: int = 150
) -> Counter[str]:
    """How often each family of edits is proposed."""
    family_of = {move.note: family for family, move, _ in legal_moves(name)}
    context = context_of(diagram, record=record, scale=scale, seen={hash_of(diagram)}.__contains__)
    notes = (
        Rules(looks=1).propose(context, np.random.default_rng(seed)).note for seed in range(number)
    )
    return Counter(family_of[note] for note in notes)


LOW, HIGH = (0.9, 0.1, 0.0, 0.0), (0.0, 0.0, 0.5, 0.5)


@pytest.mark.slow
def test_an_error_at_low_frequencies_points_to_synchronisation_and_outer_loops():
    low, high = (
        families_proposed(NAIVE, "naive", erring(*shares), "structural") for shares in (LOW, HIGH)
    )
    outer = ("synchronisation", "power loops", "AC voltage", "DC link")
    # 150 draws each; the shares differ by more than a factor of two in weight, chance moves them by
    # a tenth
    assert sum(low[name] for name in outer) > 1.3 * sum(high[name] for name in outer)


@pytest.mark.slow
def test_an_error_at_high_frequencies_points_to_filters_and_delays():
    parent = TEXTBOOK["gfl_exact"]
    low, high = (
        families_proposed(parent, "gfl_exact", erring(*shares), "module") for shares in (LOW, HIGH)
    )
    inner = [
        name for name in high if "delay" in name or "current" in name or "voltage filter" in name
    ]
    assert len(inner) >= 2
    assert sum(high[name] for name in inner) > 1.3 * sum(low[name] for name in inner)


def test_the_weights_of_the_bands_add_up_to_one_whatever_the_record_lacks():
    for record in (
        erring(1, 0, 0, 0),
        erring(0, 0, 0, 0),
        erring(0.2, 0.3, 0.1, 0.4),
        replace(erring(0, 0, 0, 0), share_by_band={}),
    ):
        assert residual_bands(record).sum() == pytest.approx(1.0)
    empty = dict.fromkeys(BAND_NAMES[2:], None) | {BAND_NAMES[0]: 0.3, BAND_NAMES[1]: 0.1}
    bands = residual_bands(replace(erring(0, 0, 0, 0), share_by_band=empty, nrmse_by_band=empty))
    np.testing.assert_allclose(bands, [0.75, 0.25, 0, 0])


def test_a_small_share_in_a_band_that_is_badly_met_still_counts():
    share = dict(zip(BAND_NAMES, (0.01, 0.0, 0.0, 0.99), strict=True))
    relative = dict(zip(BAND_NAMES, (0.9, 0.0, 0.0, 0.1), strict=True))
    bands = residual_bands(replace(erring(0, 0, 0, 0), share_by_band=share, nrmse_by_band=relative))
    assert bands[0] == pytest.approx(0.455)


# vocabularies


@pytest.mark.parametrize(
    "name", [name for name in TEXTBOOK if not ibrid.violations(TEXTBOOK[name], "paper")]
)
def test_under_the_papers_vocabulary_no_extended_kind_is_proposed(name):
    names = {kind.name for kind in PAPER_VOCABULARY}
    for _, move, diagram in moves_of(TEXTBOOK[name], PAPER_VOCABULARY):
        assert {one.kind for one in diagram.instances} <= names, move.note


def test_under_the_papers_equilibrium_the_proposals_are_legal():
    asked = replace(study(), vocabulary=PAPER_VOCABULARY, equilibrium="paper", parameters="per-op")
    for seed in range(10):
        found = after(proposed(TEXTBOOK["gfl"], seed, study=asked), TEXTBOOK["gfl"])
        assert ibrid.violations(found, PAPER_VOCABULARY, equilibrium="paper") == ()


def lag(tau):
    return [[-1 / tau]], [[1 / tau]], [[1]], [[0]]


LAG = ModuleKind(
    name="Lag",
    family="dynamic control",
    law="out = in_ / (1 + tau s)",
    inputs={"in_": Signal.SCALAR},
    outputs={"out": Signal.SCALAR},
    states=("lagged",),
    parameters={"tau": Range(1e-6, 1.0, 1e-3, "s", "time constant", divides=True)},
    state_space=lag,
    dc_gain=1.0,
    reference="a notebook",
)


def test_a_users_own_block_is_offered_where_its_signal_fits():
    kinds = (*VOCABULARY, LAG)
    places = Counter()
    for family, _, diagram in moves_of(TEXTBOOK["gfl"], kinds):
        if any(one.kind == "Lag" for one in diagram.instances):
            places[family] += 1
            assert ibrid.violations(diagram, kinds) == ()
    assert {"PLL filter", "power filters", "any wire"} <= set(places)


@pytest.mark.slow
def test_a_users_own_block_is_proposed():
    asked = replace(study(), vocabulary=(*VOCABULARY, LAG))
    parent = TEXTBOOK["gfl"]
    edits = [proposed(parent, seed, study=asked, scale="module").edit for seed in range(60)]
    assert any('g.add("Lag"' in edit for edit in edits)


# what the search may know


def imported(path: Path) -> set[str]:
    """Dotted names of what a file imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


#: Who needs a textbook program: the naive one, where a run and a sitting begin.
BEGIN_SOMEWHERE = {"running.py": "textbook_text", "agents/mcp_server.py": "textbook"}
#: Where a run takes its starts from, all shipped diagrams, when none is given; where an agent may
#: look them up; and what a fleet begins with.
STARTS = {
    "screening/edit_screening.py": (
        "textbook",
        "shipped_names",
        "published_names",
        "published_values",
    ),
    "screening/candidate_edits.py": ("textbook", "shipped_names"),
    "agents/insight.py": ("textbook", "textbook_text", "shipped_names"),
    "starting/pll_variants.py": ("published_names", "published_values"),
    "starting/start_result.py": ("textbook",),
    "fleet/examining.py": ("textbook", "shipped_names"),
}
FORBIDDEN = (
    "ibrid.structure.diagrams.library",
    "ibrid.structure.programs",
    "ibrid.plants",
    "ibrid_bench",
)
#: All files but the contract of proposers, which asks them about shipped diagrams and which nothing
#: of the search imports.
OWN = sorted(path for path in SEARCH.rglob("*.py") if path != SEARCH / "testing.py")


@pytest.mark.slow
@each_of("path", OWN, ids=lambda path: str(path.relative_to(SEARCH)))
def test_but_for_its_starts_the_search_knows_no_textbook_program_and_no_hidden_inverter(path):
    name = str(path.relative_to(SEARCH))
    allowed = {
        f"ibrid.structure.diagrams.library.{one}"
        for one in (BEGIN_SOMEWHERE.get(name), *STARTS.get(name, ()))
    }
    assert not [
        name for name in imported(path) if name.startswith(FORBIDDEN) and name not in allowed
    ]
    assert not [name for name in imported(path) if name.startswith("ibrid_search.testing")]
    used = {
        node.attr
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "ibrid"
    }
    assert used <= {"__version__"}


@pytest.mark.parametrize("name", BEGIN_SOMEWHERE)
def test_a_run_begins_with_the_naive_program_and_no_other(name):
    tree = ast.parse((SEARCH / name).read_text(encoding="utf-8"))
    calls = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == BEGIN_SOMEWHERE[name]
    ]
    assert calls
    assert all(
        [ast.literal_eval(argument) for argument in call.args] == ["naive"] for call in calls
    )


OFFLINE = [
    *(SEARCH / "proposers" / f"{name}.py" for name in ("rules", "random_edits", "pruning")),
    *sorted((SEARCH.parents[1] / "ibrid" / "parts").rglob("*.py")),
    *(
        SEARCH.parents[1] / "ibrid" / "structure" / "editing" / f"{name}.py"
        for name in ("drafting", "roles")
    ),
    SEARCH / "screening" / "plausibility.py",
]


@pytest.mark.slow
@each_of("path", OFFLINE, ids=lambda path: path.name)
def test_the_offline_proposers_hold_no_program_and_read_no_file(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    texts = [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    assert not [text for text in texts if ".add(" in text or ".connect(" in text]
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not names & {
        "open",
        "read_text",
        "read_bytes",
        "files",
        "textbook",
        "textbook_text",
        "read_program",
        "eval",
        "exec",
    }
    assert not [
        name
        for name in imported(path)
        if name.split(".")[0] in ("importlib", "pathlib", "os", "io")
    ]
