"""The roles of the blocks are recognised in the textbook's diagrams and in what engineers make of
them.
"""

import pytest
from collecting import each_of
from ibrid_bench.search.inverters import inverter

import ibrid
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.editing.roles import Roles, roles

GRID_FOLLOWING = [
    name for name in ibrid.textbook_names() if name.startswith("gfl") and name != "gfl_dc_link"
]


def seen(diagram: ibrid.Diagram | None) -> Roles:
    assert diagram is not None
    assert ibrid.violations(diagram) == ()
    found = roles(diagram, VOCABULARY)
    assert found is not None
    return found


def changed(change, name: str = "gfl") -> Roles:
    """What is seen in a textbook diagram after a change of its draft."""
    draft = Draft(ibrid.textbook(name), VOCABULARY)
    change(draft)
    draft.tidy()
    return seen(draft.diagram())


def test_blocks_that_feed_themselves_end_no_walk_through_the_diagram():
    def negation_of_itself(draft: Draft) -> None:
        (sign,) = [one for one in draft.sources("current.in_") if one.startswith("minus_i")]
        draft.disconnect("plant.i_ti", "minus_i.in_")
        draft.connect(sign, "minus_i.in_")

    draft = Draft(ibrid.textbook("gfl"), VOCABULARY)
    negation_of_itself(draft)
    found = roles(draft.diagram(), VOCABULARY)
    assert found is not None
    assert found.current_loop is None


@each_of("name", GRID_FOLLOWING)
def test_a_grid_following_inverter_has_a_pll_a_current_loop_and_outer_loops(name):
    found = seen(ibrid.textbook(name))
    assert (found.plant, found.frequency, found.current_loop) == ("plant", "pll", "current")
    assert (found.power, found.outer) == (("power",), ("p_loop", "q_loop"))
    assert found.voltage_loop is None
    assert (found.command, found.reference) == ("plant.u_r", "current.in_")
    assert found.rotated
    assert found.missing_layers == 0


@pytest.mark.parametrize(
    ("name", "lcl", "current"), [("gfl", True, "plant.i_ti"), ("gfl_l_filter", False, "plant.i_g")]
)
def test_the_converter_current_is_that_of_the_filter(name, lcl, current):
    found = seen(ibrid.textbook(name))
    assert (found.lcl, found.current, found.voltage) == (lcl, current, "plant.e")


def test_the_naive_start_has_a_plant_and_nothing_else():
    found = seen(ibrid.textbook("naive"))
    assert (found.plant, found.lcl, found.rotated) == ("plant", False, False)
    assert (found.frequency, found.current_loop, found.voltage_loop) == (None, None, None)
    assert (found.power, found.outer) == ((), ())
    assert found.reference == found.command == "plant.u_r"
    assert found.missing_layers == 3


@pytest.mark.parametrize("kind", ["Delay", "LPF1_dq", "Pade1_dq"])
def test_the_current_loop_is_found_behind_what_delays_the_command(kind):
    found = changed(lambda draft: draft.insert_before("plant.u_r", kind, "on_its_way"))
    assert (found.current_loop, found.reference) == ("current", "current.in_")


@pytest.mark.parametrize("kind", ["Delay", "LPF1_dq", "Pade1_dq"])
@pytest.mark.parametrize("place", ["before the sign", "behind the sign"])
def test_the_current_loop_is_found_through_a_filtered_measurement(kind, place):
    def filtered(draft: Draft) -> None:
        if place == "before the sign":
            draft.insert("plant.i_ti", ["minus_i.in_"], kind, "filter")
        else:
            draft.insert("minus_i.out", ["current.in_"], kind, "filter")

    assert changed(filtered).current_loop == "current"


def test_a_current_loop_on_the_grid_current_is_one_too():
    def other_current(draft: Draft) -> None:
        draft.disconnect("plant.i_ti", "minus_i.in_")
        draft.connect("plant.i_g", "minus_i.in_")

    assert changed(other_current).current_loop == "current"


def test_loops_that_drive_the_command_past_the_current_loop_are_not_its_outer_loops():
    def past_the_current_loop(draft: Draft) -> None:
        draft.disconnect("i_ref.out", "current.in_")
        draft.connect("i_ref.out", "plant.u_r")

    found = changed(past_the_current_loop)
    assert (found.current_loop, found.outer) == ("current", ())
    assert found.missing_layers == 1


def test_a_regulator_that_adds_its_measurement_is_no_feedback_loop():
    def wrong_sign(draft: Draft) -> None:
        draft.disconnect("plant.i_ti", "minus_i.in_")
        draft.connect(draft.negated("plant.e"), "minus_i.in_")
        draft.connect("plant.i_ti", "current.in_")

    assert changed(wrong_sign).current_loop is None


def test_two_changes_of_sign_are_none():
    def turned_twice(draft: Draft) -> None:
        draft.insert("minus_i.out", ["current.in_"], "Negate_dq", "again")

    assert changed(turned_twice).current_loop is None


def test_a_static_gain_can_be_a_current_loop():
    assert (
        changed(lambda draft: draft.replace("current", "Gain_dq", "proportional")).current_loop
        == "proportional"
    )


def test_without_a_current_loop_the_command_is_the_reference():
    def removed(draft: Draft) -> None:
        draft.remove("minus_i")
        draft.bypass("current")

    found = changed(removed)
    assert (found.current_loop, found.reference) == (None, "plant.u_r")
    assert found.outer == ("p_loop", "q_loop")
    assert found.missing_layers == 1


def test_a_droop_inverter_has_a_voltage_loop_and_a_droop_for_its_frequency():
    found = seen(inverter("droop").truth)
    assert (found.frequency, found.current_loop, found.voltage_loop) == (
        "p_droop",
        "current",
        "voltage",
    )
    assert found.outer == ("q_droop",)
    assert found.missing_layers == 0


def test_a_voltage_loop_stands_for_the_inner_and_the_outer_loop():
    def bare(draft: Draft) -> None:
        for name in ("minus_i", "q_droop", "q_filter"):
            draft.remove(name)
        draft.bypass("current")

    draft = Draft(inverter("droop").truth or ibrid.Diagram(), VOCABULARY)
    bare(draft)
    draft.tidy()
    found = seen(draft.diagram())
    assert (found.current_loop, found.voltage_loop, found.outer) == (None, "voltage", ())
    assert found.missing_layers == 0


def test_one_axis_is_an_outer_loop_also_behind_filters():
    def one_axis(draft: Draft) -> None:
        draft.remove("q_loop")
        draft.insert("p_loop.out", draft.targets("p_loop.out"), "LPF1", "late")

    found = changed(one_axis)
    assert found.outer == ("p_loop",)
    assert found.missing_layers == 0


def test_regulators_that_reach_no_axis_of_a_reference_are_no_outer_loops():
    def elsewhere(draft: Draft) -> None:
        draft.insert("plant.e_q", ["pll.e_q"], "PI", "before_the_pll")

    assert changed(elsewhere).outer == ("p_loop", "q_loop")


def test_each_missing_layer_counts():
    def no_power(draft: Draft) -> None:
        draft.remove("power")

    def no_pll(draft: Draft) -> None:
        no_power(draft)
        for rotation, before, after in (
            ("park_v", "v_DQ", "plant.v_in"),
            ("park_i", "plant.i_g", "i_DQ"),
        ):
            draft.remove(rotation)
            draft.connect(before, after)
        draft.remove("pll")

    assert changed(no_power).missing_layers == 1
    found = changed(no_pll)
    assert (found.frequency, found.rotated, found.missing_layers) == (None, False, 2)


def test_an_unusual_controller_is_recognised_all_the_same():
    found = seen(inverter("unusual").truth)
    assert (found.frequency, found.current_loop, found.outer) == (
        "pll",
        "current",
        ("p_loop", "q_loop"),
    )


def test_a_diagram_without_one_plant_has_no_roles():
    draft = Draft(ibrid.textbook("naive"), VOCABULARY)
    draft.add("LCL", "second")
    assert roles(draft.diagram(), VOCABULARY) is None
    assert roles(ibrid.Diagram(), VOCABULARY) is None
