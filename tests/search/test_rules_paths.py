"""Single edits lead from the naive start to every reference inverter, and what follows the command
follows it all along.
"""

import pytest
from collecting import each_of
from ibrid_search.proposers.rules import FAMILIES
from ibrid_search.screening.plausibility import count_issues
from scripted_search import naive_record
from sharing import shared

import ibrid
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
from ibrid.parts.editing.view import Move, View, followers, view_of, views_of
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.editing.frames import put_into_frame

NAIVE = ibrid.textbook("naive")
LCL = "LCL filter instead of the L filter, control of the converter current"
PLL = "synchronisation by a PLL, with the rotations into its frame"
DROOP = "synchronisation by a droop of the filtered active power (grid-forming)"
OSCILLATOR = "synchronisation by a virtual oscillator, which also gives the voltage (grid-forming)"
CURRENT, VOLTAGE = (
    "a PI controller of the converter current, alone",
    "a PI controller of the filter voltage, with the outer loops as its reference",
)
POWERS = "PI control of p and q, one pair of gains"
DECOUPLING = "decoupling of the current with the measured frequency"
FEEDFORWARD = "voltage feedforward"
CASCADE = (
    "decoupling of the voltage with the measured frequency",
    DECOUPLING,
    "active damping by the fast part of the filter voltage",
)
VIRTUAL = "a virtual reactance with the controller's frequency"
Q_DROOP = "a droop of the filtered reactive power on the d axis"
#: Edits by their notes, in an order in which an engineer might make them; others lead there too.
FOLLOWING = (PLL, "a PI controller of the current, alone", POWERS, DECOUPLING, FEEDFORWARD)
FORMING = (LCL, DROOP, CURRENT, VOLTAGE, Q_DROOP, VIRTUAL, *CASCADE)
PATHS = {
    "gfl_l_filter": FOLLOWING,
    "gfl_pll_filter_exact": (
        LCL,
        PLL,
        CURRENT,
        POWERS,
        DECOUPLING,
        FEEDFORWARD,
        "LPF1 before the PLL",
    ),
    "gfl_dc_link": (
        LCL,
        PLL,
        CURRENT,
        POWERS,
        DECOUPLING,
        "PI control of the voltage of a DC link on the d axis",
        FEEDFORWARD,
        "PI control of the voltage magnitude on the q axis",
        "active damping by the capacitor current",
    ),
    "gfm_droop": FORMING,
    "gfm_vsm": (*FORMING, "the frequency of a PLL damps the swing at droop_filter"),
    "gfm_dvoc": (LCL, OSCILLATOR, CURRENT, VOLTAGE, *CASCADE),
    "hybrid_gfl_gfm": (
        LCL,
        PLL,
        CURRENT,
        POWERS,
        DECOUPLING,
        "a droop of the active power beside the PLL",
        "LPF1 on the measured powers",
    ),
    "parallel_gfl_gfm": (
        *FORMING,
        "a second device in parallel, without a controller yet",
        *(f"{note}, in the device of plant_2" for note in FOLLOWING),
    ),
}


def moves_of(diagram: ibrid.Diagram) -> dict[str, tuple[View, Move]]:
    """All that the rules list, by what they say."""
    return {
        view.words(move): (view, move)
        for view in views_of(diagram, VOCABULARY)
        for family in FAMILIES
        for move in family.moves(view)
    }


def made(found: tuple[View, Move]) -> ibrid.Diagram:
    """The diagram after a move in its view."""
    view, move = found
    return view.after(move)


def _done(_: object) -> None:
    """What a move's change returns."""


@shared
def path(name: str) -> tuple[ibrid.Diagram, ...]:
    """The naive start and what each edit makes of it."""
    found = [NAIVE]
    for note in PATHS[name]:
        view, move = moves_of(found[-1])[note]
        found.append(view.after(move))
    return tuple(found)


@pytest.mark.slow
@each_of("name", PATHS)
def test_single_edits_lead_from_the_naive_start_to_the_textbook_program(name):
    assert ibrid.compare(path(name)[-1], ibrid.textbook(name)).same


@pytest.mark.slow
@each_of("name", PATHS)
def test_every_program_on_the_way_is_legal_and_new(name):
    assert [ibrid.violations(diagram) for diagram in path(name)] == [()] * len(path(name))
    assert len({structure_hash(diagram, VOCABULARY) for diagram in path(name)}) == len(path(name))


def test_every_textbook_inverter_but_variations_of_these_has_a_path():
    variations = {
        "gfl",
        "gfl_delay",
        "gfl_exact",
        "gfl_l_filter_delay",
        "gfl_pll_filter",
        "gfl_power_filter",
    }
    assert set(ibrid.textbook_names()) == {"naive"} | set(PATHS) | variations


# what follows the command


def test_a_dc_link_follows_the_command_through_every_edit():
    for view, move in moves_of(ibrid.textbook("gfl_dc_link")).values():
        after = view.after(move)
        draft = Draft(after, VOCABULARY)
        for link in draft.named("DC_link"):
            assert set(draft.sources(f"{link}.u")) == set(draft.sources("plant.u_r")), move.note


def test_a_dc_link_that_takes_something_else_is_left_alone():
    draft = Draft(ibrid.textbook("gfl_dc_link"), VOCABULARY)
    for source in draft.sources("dc_link.u"):
        draft.disconnect(source, "dc_link.u")
    draft.connect("plant.e", "dc_link.u")
    assert followers(draft) == frozenset()
    view = view_of(draft.diagram(), VOCABULARY)
    assert view is not None
    after = view.after(
        Move("a delay", lambda one: _done(one.insert_before("plant.u_r", "Delay", "x")))
    )
    assert Draft(after, VOCABULARY).sources("dc_link.u") == ["plant.e"]


def test_the_current_of_a_dc_link_is_that_of_the_converter_whatever_the_controller_measures():
    for note, (view, move) in moves_of(ibrid.textbook("gfl_dc_link")).items():
        draft = Draft(view.after(move), VOCABULARY)
        for link in draft.named("DC_link"):
            plant = draft.kind("plant").outputs
            assert draft.sources(f"{link}.i") == [
                "plant.i_ti" if "i_ti" in plant else "plant.i_g"
            ], note


# two devices


def test_each_of_two_devices_is_seen_as_if_it_were_alone():
    both = ibrid.textbook("parallel_gfl_gfm")
    following, forming = views_of(both, VOCABULARY)
    assert ibrid.compare(following.diagram, ibrid.textbook("gfl_l_filter")).same
    assert ibrid.compare(forming.diagram, ibrid.textbook("gfm_droop")).same
    assert following.whole is forming.whole is both
    assert not following.alone
    assert view_of(both, VOCABULARY, device=1) is not None
    assert view_of(both, VOCABULARY, device=2) is None


@pytest.mark.parametrize("device", [0, 1])
def test_an_edit_of_nothing_leaves_two_devices_as_they_are(device):
    both = ibrid.textbook("parallel_gfl_gfm")
    view = view_of(both, VOCABULARY, device=device)
    assert view is not None
    assert ibrid.program_text(
        view.after(Move("nothing", lambda draft: None))
    ) == ibrid.program_text(both)


@pytest.mark.nightly
@pytest.mark.parametrize("device", [0, 1])
def test_an_edit_of_one_device_leaves_the_other_as_it_is(device):
    both = ibrid.textbook("parallel_gfl_gfm")
    view, other = (view_of(both, VOCABULARY, device=one) for one in (device, 1 - device))
    assert view is not None
    assert other is not None
    changed = 0
    for family in FAMILIES:
        for move in family.moves(view):
            after = view.after(move)
            if not ibrid.violations(after):
                same = view_of(after, VOCABULARY, device=1 - device)
                assert same is not None
                assert ibrid.program_text(same.diagram) == ibrid.program_text(other.diagram), (
                    move.note
                )
                changed += 1
    assert changed > 50


def test_a_name_that_the_other_device_has_is_given_another():
    both = ibrid.textbook("parallel_gfl_gfm")
    view = view_of(both, VOCABULARY)
    assert view is not None
    taken = Move(
        "a filter", lambda draft: _done(draft.insert_before("gfl_pll.e_q", "LPF1", "gfm_p_filter"))
    )
    after = view.after(taken)
    assert ibrid.violations(after) == ()
    assert {"gfm_p_filter", "gfm_p_filter_2"} <= {one.name for one in after.instances}


def test_a_second_device_without_a_controller_can_be_taken_away_again():
    (two,) = second_device_beside("gfl")
    assert ibrid.violations(two) == ()
    assert len(views_of(two, VOCABULARY)) == 2
    (note,) = [note for note in moves_of(two) if note.startswith("without the device of")]
    assert ibrid.compare(made(moves_of(two)[note]), ibrid.textbook("gfl")).same


@pytest.mark.slow
def test_a_device_with_a_controller_is_not_taken_away_in_one_edit():
    both = ibrid.textbook("parallel_gfl_gfm")
    for note, (view, move) in moves_of(both).items():
        after = view.after(move)
        assert ibrid.violations(after) or len(views_of(after, VOCABULARY)) == 2, note


def second_device_beside(name: str) -> list[ibrid.Diagram]:
    """Of a textbook program all that the family makes."""
    (view,) = views_of(ibrid.textbook(name), VOCABULARY)
    return [
        view.after(move)
        for family in FAMILIES
        if family.name == "second device"
        for move in family.moves(view)
    ]


def test_of_two_devices_the_layers_that_are_missing_are_those_of_the_more_complete_one():
    (both,) = second_device_beside("gfl")
    assert count_issues(both, naive_record(), VOCABULARY).missing == 0


def test_a_second_device_is_no_way_round_a_controller():
    assert second_device_beside("naive") == []


# single edits of the families beyond grid following


def note_of(name: str, part: str) -> ibrid.Diagram:
    """A textbook program after the only edit whose note has this part."""
    ((view, move),) = [
        found for note, found in moves_of(ibrid.textbook(name)).items() if part in note
    ]
    return view.after(move)


def test_a_blend_of_pll_and_droop_adds_their_frequencies_everywhere():
    draft = Draft(note_of("gfl_exact", "a droop of the active power beside the PLL"), VOCABULARY)
    assert draft.named("SRF_PLL") == []
    both = set(draft.sources("plant.delta_omega"))
    assert len(both) == 2
    assert set(draft.sources("decoupling.delta_omega")) == set(draft.sources("angle.in_")) == both
    assert draft.sources("park_v.delta") == draft.sources("park_i.delta") == ["angle.out"]


def test_a_pll_beside_a_droop_is_the_same_blend():
    draft = Draft(ibrid.textbook("gfl_exact"), VOCABULARY)
    draft.remove("pll")
    gain, angle = draft.add("Gain", "droop"), draft.add("Integrator", "angle")
    draft.chain("power.p", f"{gain}.in_", f"{gain}.out", f"{angle}.in_")
    put_into_frame(draft, "plant", f"{gain}.out", f"{angle}.out")
    formed = draft.diagram()
    assert ibrid.violations(formed) == ()
    one = made(moves_of(formed)["a PLL beside the droop"])
    other = note_of("gfl_exact", "a droop of the active power beside the PLL")
    assert ibrid.compare(one, other).same


def test_a_current_loop_alone_keeps_the_outer_loops_as_its_reference():
    view, move = moves_of(NAIVE)[POWERS]
    powers = view.after(move)
    after = made(moves_of(powers)["a PI controller of the current, alone"])
    (seen,) = views_of(after, VOCABULARY)
    assert seen.roles.current_loop == "current"
    assert set(seen.roles.outer) == {"p_loop", "q_loop"}
    assert "gain" not in seen.draft.instances


def test_under_the_papers_vocabulary_the_voltage_magnitude_is_the_d_component():
    (view,) = views_of(ibrid.textbook("gfl"), PAPER_VOCABULARY)
    (move,) = [
        move for family in FAMILIES if family.name == "AC voltage" for move in family.moves(view)
    ]
    kinds = {one.kind for one in view.after(move).instances}
    assert "SliceD" in kinds
    assert "Magnitude" not in kinds


def test_a_grid_forming_controller_may_give_up_its_power_loops_for_a_voltage_loop():
    hybrid = ibrid.textbook("hybrid_gfl_gfm")
    after = made(
        moves_of(hybrid)["a PI controller of the filter voltage, in place of the outer loops"]
    )
    assert ibrid.violations(after) == ()
    (seen,) = views_of(after, VOCABULARY)
    assert seen.roles.voltage_loop == "voltage"
    assert seen.roles.outer == ()
    assert seen.roles.frequency == "pll"
