"""Pruning takes away, and nothing else; what the data do not see goes first."""

from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from ibrid_search.edits import apply_edit
from ibrid_search.proposal import Proposal
from ibrid_search.proposers.pruning import Pruning, removal_moves, unseen_modules
from scripted_search import QUICK, context_of, record_of, study

import ibrid
from ibrid.evaluation.record import Record
from ibrid.modules.vocabulary import VOCABULARY, find_kind
from ibrid.parts.editing.view import view_of
from ibrid.structure.comparison.compare import compare
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.editing.drafting import Draft

NAMES = [
    name for name in ibrid.textbook_names() if name not in ("naive", "parallel_gfl_gfm")
]  # one plant, something to go


def hash_of(diagram: ibrid.Diagram) -> str:
    return structure_hash(diagram, VOCABULARY)


def free_numbers(diagram: ibrid.Diagram) -> int:
    """How many a fit would have."""
    names = {
        one.bindings.get(key, f"{one.name}.{key}")
        for one in diagram.instances
        for key in find_kind(one.kind, VOCABULARY).parameters
    }
    return len(names)


def pruned(diagram: ibrid.Diagram, seed: int, record: Record | None = None, **changes) -> Proposal:
    seen = changes.pop("seen", {hash_of(diagram)})
    context = context_of(diagram, record=record, seen=seen.__contains__)
    return Pruning(**changes).propose(context, np.random.default_rng(seed))


def after(proposal: Proposal, diagram: ibrid.Diagram) -> ibrid.Diagram:
    assert proposal.failure == ""
    return ibrid.parse_program(apply_edit(proposal.edit, ibrid.program_text(diagram)))


def crowded() -> ibrid.Diagram:
    """A textbook controller with two filters that it does not need."""
    draft = Draft(ibrid.textbook("gfl_exact"), VOCABULARY)
    draft.insert("plant.i_ti", draft.targets("plant.i_ti"), "LPF1_dq", "current_filter")
    draft.insert("plant.e_q", ["pll.e_q"], "Notch", "notch")
    return draft.diagram()


def open_to(*names: str) -> Record:
    """A record whose data leave the parameters of these modules open, and see all others."""
    record = record_of(ibrid.program_text(crowded()))
    intervals = {
        f"{one.name}.{key}": None if one.name in names else (0.5, 2.0)
        for one in crowded().instances
        for key in find_kind(one.kind, VOCABULARY).parameters
    }
    return replace(record, intervals=dict.fromkeys(record.parameters, intervals), at_bound=())


@pytest.mark.slow
@each_of("thorough", [False, True], ids=["one thing", "thorough"])
@each_of("name", NAMES)
def test_what_comes_out_is_legal_new_and_smaller(name, thorough):
    parent = ibrid.textbook(name)
    seen = {hash_of(parent)}
    for seed in range(8):
        proposal = pruned(parent, seed, thorough=thorough, seen=seen)
        found = after(proposal, parent)
        seen.add(hash_of(found))
        assert ibrid.violations(found) == ()
        modules = {one.name for one in found.instances if one.kind != "ConstZero"}
        assert modules <= {one.name for one in parent.instances}, proposal.note
        size = (free_numbers(found), len(modules), len(found.connections))
        before = (free_numbers(parent), len(parent.instances), len(parent.connections))
        assert all(a <= b for a, b in zip(size[:2], before[:2], strict=True)), proposal.note
        assert size != before


@each_of("name", NAMES)
def test_everything_can_go_but_the_plant(name):
    view = view_of(ibrid.textbook(name), VOCABULARY)
    assert view is not None
    notes = [move.note for move in removal_moves(view)]
    for one in view.diagram.instances:
        if one.kind not in ("LCL", "LFilter", "Rot_v", "Rot_i", "PackDQ", "ConstZero"):
            assert any(one.name in note for note in notes), one.name


@each_of(
    "name, kinds",
    [
        ("gfl_ll_droop", {"LFilter"}),
        ("gfl_exact", {"LFilter", "LLFilter"}),
        ("gfl_trap", {"LCL", "LLFilter"}),
    ],
)
def test_the_filter_can_lose_what_not_every_one_has(name, kinds):
    view = view_of(ibrid.textbook(name), VOCABULARY)
    assert view is not None
    plant = view.roles.plant
    less = [
        view.after(move)
        for move in removal_moves(view)
        if plant in move.note and ": remove" in move.note
    ]
    assert kinds <= {one.kind for diagram in less for one in diagram.instances if one.name == plant}
    assert all(free_numbers(diagram) < free_numbers(view.diagram) for diagram in less)


def test_what_a_small_vocabulary_cannot_draw_is_not_tried():
    """Each kind of filter left out of the vocabulary in turn: whatever is taken away can be drawn
    without it.
    """
    for name in ("gfl_exact", "gfl_trap", "gfl_ll_droop"):
        diagram = ibrid.textbook(name)
        own = {one.kind for one in diagram.instances}
        for missing in ({"LFilter"}, {"LLFilter"}, {"LCL", "LFilter", "LLFilter"}):
            view = view_of(
                diagram,
                tuple(kind for kind in VOCABULARY if kind.name in own or kind.name not in missing),
            )
            assert view is not None
            assert all(view.after(move) != diagram for move in removal_moves(view)), (name, missing)


@pytest.mark.parametrize("unseen", ["current_filter", "notch"])
def test_what_the_data_leave_open_goes_first(unseen):
    for seed in range(6):
        found = after(pruned(crowded(), seed, open_to(unseen)), crowded())
        assert unseen not in {one.name for one in found.instances}


@pytest.mark.parametrize("unseen", ["decoupling", "p_loop"])
def test_in_a_usual_controller_too(unseen):
    parent = ibrid.textbook("gfl_exact")
    for seed in range(6):
        note = pruned(parent, seed, open_to(unseen)).note
        assert unseen in note


def test_what_no_usual_controller_has_goes_before_what_it_has():
    for seed in range(6):
        found = after(pruned(crowded(), seed, open_to()), crowded())
        gone = {one.name for one in crowded().instances} - {one.name for one in found.instances}
        assert gone & {"current_filter", "notch"}


def test_a_block_at_the_end_of_its_box_counts_as_unseen():
    record = replace(open_to(), at_bound=("notch.Q at its upper bound",))
    assert unseen_modules(record) == {"notch"}
    for seed in range(6):
        assert "notch" not in {
            one.name for one in after(pruned(crowded(), seed, record), crowded()).instances
        }


def test_bounds_are_read_as_an_evaluation_writes_them():
    program = ibrid.parse_program(
        ibrid.program_text(ibrid.textbook("naive")).replace('"gain")', '"gain", k=(0.1, 0.2))')
    )
    record = ibrid.evaluate(program, study().sweep, settings=QUICK)
    assert record.at_bound != ()
    assert "gain" in unseen_modules(record)


@pytest.mark.slow
def test_of_two_blocks_with_the_same_parameters_both_can_go_at_once():
    parent = ibrid.textbook("gfl_power_filter")
    seen, found = {hash_of(parent)}, []
    for seed in range(200):
        proposal = pruned(parent, seed, seen=seen)
        if proposal.failure:
            break
        found.append(after(proposal, parent))
        seen.add(hash_of(found[-1]))
    assert hash_of(ibrid.textbook("gfl_exact")) in {hash_of(one) for one in found}


@pytest.mark.slow
def test_pairs_come_when_every_single_thing_was_tried():
    def everything(thorough: bool) -> list[ibrid.Diagram]:
        seen, found = {hash_of(crowded())}, []
        for seed in range(300):
            proposal = pruned(
                crowded(), seed, open_to("current_filter", "notch"), thorough=thorough, seen=seen
            )
            if proposal.failure:
                return found
            found.append(after(proposal, crowded()))
            seen.add(hash_of(found[-1]))
        raise AssertionError("pruning does not end")

    single, both = everything(thorough=False), everything(thorough=True)
    assert {hash_of(one) for one in single} == {hash_of(one) for one in both[: len(single)]}
    plain = hash_of(ibrid.textbook("gfl_exact"))
    assert plain not in {hash_of(one) for one in single}
    assert plain in {hash_of(one) for one in both}


@pytest.mark.slow
def test_each_of_two_devices_can_lose_something():
    parent = ibrid.textbook("parallel_gfl_gfm")
    notes, seen = [], {hash_of(parent)}
    while not (proposal := pruned(parent, len(seen), seen=seen)).failure:
        seen.add(hash_of(after(proposal, parent)))
        notes.append(proposal.note)
    for plant in ("gfl_plant", "gfm_plant"):
        assert sum(note.endswith(f"in the device of {plant}") for note in notes) > 5


def test_nothing_left_is_a_sentence():
    proposal = Pruning(thorough=True).propose(
        context_of(crowded(), seen=lambda _: True), np.random.default_rng(0)
    )
    assert proposal.edit == ""
    assert "has been tried" in proposal.failure


def test_the_same_random_numbers_take_away_the_same():
    assert pruned(crowded(), 3) == pruned(crowded(), 3)
    assert len({pruned(crowded(), seed).edit for seed in range(12)}) > 1


def with_gain(
    k: float, interval: tuple[float, float] | None = None
) -> tuple[ibrid.Diagram, Record]:
    """The converter current controlled as grid current plus k times the capacitor current, which is
    the same for k = 1.
    """
    draft = Draft(ibrid.textbook("gfl_exact"), VOCABULARY)
    (target,) = [one for one in draft.targets("plant.i_ti") if one.startswith("minus")]
    draft.disconnect("plant.i_ti", target)
    draft.connect("plant.i_g", target)
    draft.insert("plant.i_C", [target], "Gain_dq", "share")
    diagram = draft.diagram()
    record = record_of(ibrid.program_text(diagram))
    values = {op: {**record.parameters[op], "share.k": k} for op in record.parameters}
    return diagram, replace(
        record, parameters=values, intervals={key: {"share.k": interval} for key in values}
    )


@pytest.mark.parametrize(("k", "interval"), [(1.0, None), (0.99, None), (1.2, (0.9, 1.5))])
def test_a_gain_that_was_fitted_to_one_is_a_wire(k, interval):
    diagram, record = with_gain(k, interval)
    proposal = pruned(diagram, 0, record, thorough=True)
    assert proposal.note == "share is 1, a wire"
    assert compare(after(proposal, diagram), ibrid.textbook("gfl_exact")).same


@pytest.mark.parametrize("interval", [None, (-3.0, 1.5)])
def test_a_gain_that_was_fitted_to_minus_one_is_a_sign(interval):
    diagram, record = with_gain(-1.0, interval)
    proposal = pruned(diagram, 0, record, thorough=True)
    assert proposal.note == "share is -1, a sign"
    found = after(proposal, diagram)
    assert [one.kind for one in found.instances if one.name == "minus_share"] == ["Negate_dq"]
    assert free_numbers(found) == free_numbers(diagram) - 1
    assert ibrid.violations(found) == ()


@pytest.mark.parametrize(
    ("k", "interval", "thorough"),
    [(1.2, None, True), (1.2, (1.1, 1.3), True), (-0.5, (-3.0, 1.5), True), (1.0, None, False)],
)
def test_any_other_gain_is_left_alone_and_so_is_every_gain_before_the_end(k, interval, thorough):
    diagram, record = with_gain(k, interval)
    note = pruned(diagram, 0, record, thorough=thorough).note
    assert "a wire" not in note
    assert "a sign" not in note


def roundabout() -> ibrid.Diagram:
    """The PLL behind its filter drawn as a frequency meter whose frame turns with its own output,
    and an integrator.
    """
    draft = Draft(ibrid.textbook("gfl_pll_filter_exact"), VOCABULARY)
    (pll,) = draft.named("SRF_PLL")
    (scalar,) = (one.split(".")[0] for one in draft.sources(f"{pll}.e_q"))
    meter, angle, low_pass = (
        draft.add(kind, stem)
        for kind, stem in (
            ("PLL_frequency", "meter"),
            ("Integrator", "angle"),
            ("LPF1_dq", "filter"),
        )
    )
    draft.chain("plant.e", f"{low_pass}.in_", f"{low_pass}.out", f"{meter}.v")
    draft.chain(
        f"{meter}.delta_omega_pll",
        f"{angle}.in_",
        f"{meter}.delta_omega_pll",
        f"{meter}.delta_omega",
    )
    for target in draft.targets(f"{pll}.delta_omega"):
        draft.connect(f"{meter}.delta_omega_pll", target)
    for target in draft.targets(f"{pll}.delta"):
        draft.connect(f"{angle}.out", target)
    draft.remove(pll)
    draft.remove(scalar)
    return draft.diagram()


def test_a_frequency_meter_that_turns_its_own_frame_is_a_pll():
    diagram, sweep = roundabout(), study().sweep
    assert not compare(diagram, ibrid.textbook("gfl_pll_filter_exact")).same
    assert ibrid.evaluate(diagram, sweep).nrmse == pytest.approx(
        0.0, abs=1e-9
    )  # of data that have the PLL
    proposal = pruned(diagram, 0, record_of(ibrid.program_text(diagram)), thorough=True)
    assert proposal.note == "meter turns its own frame, a PLL"
    assert compare(after(proposal, diagram), ibrid.textbook("gfl_pll_filter_exact")).same


def test_one_that_watches_another_frame_is_none():
    draft = Draft(roundabout(), VOCABULARY)
    draft.disconnect("meter.delta_omega_pll", "meter.delta_omega")
    draft.connect("no_frequency.out", "meter.delta_omega")
    draft.add("ConstZero", "no_frequency")
    assert "a PLL" not in pruned(draft.diagram(), 0, thorough=True).note
