"""A draft is edited wire by wire and comes out whole: nothing undriven, nothing idle, nothing
shared with the dead.
"""

import pytest
from collecting import each_of

import ibrid
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.compiling.check import violations, warnings
from ibrid.structure.editing.drafting import Draft

GFL = ibrid.textbook("gfl_pll_filter_exact")


def draft_of(name: str = "gfl_pll_filter_exact") -> Draft:
    return Draft(ibrid.textbook(name), VOCABULARY)


def same(one: ibrid.Diagram, other: ibrid.Diagram) -> bool:
    return structure_hash(one, VOCABULARY) == structure_hash(other, VOCABULARY)


def assert_whole(draft: Draft) -> None:
    """Legal, and no module without a way to the terminal current."""
    diagram = draft.diagram()
    assert violations(diagram, VOCABULARY) == ()
    assert [one.reason for one in warnings(diagram, VOCABULARY)] == []


# looking


@each_of("name", ibrid.textbook_names())
def test_a_draft_that_nobody_touched_is_the_diagram(name):
    draft = draft_of(name)
    draft.tidy()
    assert draft.diagram() == ibrid.textbook(name)


def test_upstream_of_an_input_is_what_can_reach_it():
    draft = draft_of("naive")
    assert draft.upstream("plant.u_r") == {"gain"}
    assert draft.upstream("gain.in_") == set()
    assert draft.upstream("plant.i_g") == {"plant", "gain", "no_frequency"}


# putting in


def test_a_block_on_a_wire_leaves_the_other_wires_alone():
    draft = draft_of()
    name = draft.insert("plant.i_ti", ["minus_i.in_"], "LPF1_dq", "filter")
    assert draft.targets(f"{name}.out") == ["minus_i.in_"]
    assert set(draft.targets("plant.i_ti")) == {"decoupling.in_", f"{name}.in_"}
    assert_whole(draft)


def test_a_block_before_an_input_takes_the_whole_sum():
    draft = draft_of()
    before = draft.sources("plant.u_r")
    name = draft.insert_before("plant.u_r", "Delay", "delay")
    assert draft.sources("plant.u_r") == [f"{name}.out"]
    assert draft.sources(f"{name}.in_") == before
    assert_whole(draft)


def test_a_block_that_feeds_itself_is_bypassed_without_a_wire_to_nowhere():
    draft = draft_of()
    delay = draft.insert_before("plant.u_r", "Delay", "delay")
    draft.connect(f"{delay}.out", f"{delay}.in_")
    draft.bypass(delay)
    assert same(draft.diagram(), GFL)
    assert_whole(draft)


def test_what_is_put_in_and_bypassed_again_leaves_no_trace():
    draft = draft_of()
    draft.bypass(draft.insert_before("plant.u_r", "Delay", "delay"))
    draft.bypass(draft.insert("plant.e", draft.targets("plant.e"), "LPF1_dq", "filter"))
    assert same(draft.diagram(), GFL)


def test_a_name_that_is_taken_gets_a_number():
    draft = draft_of("naive")
    assert [draft.add("Gain_dq", "gain") for _ in range(2)] == ["gain_2", "gain_3"]


def test_a_wire_that_is_there_is_not_made_twice():
    draft = draft_of("naive")
    draft.connect("gain.out", "plant.u_r")
    assert draft.sources("plant.u_r") == ["gain.out"]


# signs


def test_minus_a_signal_is_taken_from_the_negation_that_is_there():
    draft = draft_of()
    assert draft.negated("plant.i_ti") == "minus_i.out"
    assert draft.negated("power.p") == "minus_p.out"
    assert same(draft.diagram(), GFL)


def test_minus_a_signal_gets_a_negation_of_its_kind():
    draft = draft_of()
    vector, scalar = draft.negated("plant.e"), draft.negated("power.q")
    assert [draft.kind(one.split(".")[0]).name for one in (vector, scalar)] == [
        "Negate_dq",
        "Negate",
    ]
    assert draft.negated("plant.e") == vector


def test_the_negation_of_a_sum_is_not_the_negation_of_its_parts():
    draft = draft_of()
    draft.connect("plant.i_g", "minus_i.in_")
    assert draft.negated("plant.i_ti") != "minus_i.out"


# exchanging


def test_another_kind_keeps_the_wires_of_its_common_ports():
    draft = draft_of("gfl")
    name = draft.replace("decoupling", "JMul_omega", "decoupling")
    assert draft.sources(f"{name}.in_") == ["plant.i_ti"]
    assert draft.targets(f"{name}.out") == ["plant.u_r"]
    draft.connect("pll.delta_omega", f"{name}.delta_omega")
    assert same(draft.diagram(), ibrid.textbook("gfl_exact"))


def test_another_kind_loses_the_wires_of_ports_that_it_lacks():
    draft = draft_of("gfl")
    draft.rename(draft.replace("plant", "LFilter", "other"), "plant")
    assert draft.sources("minus_i.in_") == []  # i_ti is a port of the LCL alone
    assert draft.sources("power.i") == ["plant.i_g"]


def test_a_port_that_carries_another_signal_keeps_no_wire():
    draft = draft_of()
    name = draft.replace("minus_p", "Gain_dq", "vector")
    assert draft.sources(f"{name}.in_") == []
    assert draft.targets(f"{name}.out") == []


def test_a_new_name_is_used_in_every_wire_and_in_what_is_shared():
    draft = draft_of()
    draft.bind("q_loop", kP="p_loop.kP", kI="p_loop.kI")
    draft.unbind("p_loop", "kP", "kI")
    before = draft.diagram()
    draft.rename("p_loop", "active")
    assert draft.instances["q_loop"].bindings == {"kP": "active.kP", "kI": "active.kI"}
    assert same(draft.diagram(), before)


# taking away


def test_the_rest_goes_on_sharing_when_the_owner_of_a_parameter_goes():
    draft = draft_of()
    filters = [
        draft.insert(f"power.{axis}", draft.targets(f"power.{axis}"), "LPF1", "filter")
        for axis in ("p", "q")
    ]
    filters.append(draft.insert("pll_filter.out", ["pll.e_q"], "LPF1", "filter"))
    for name in filters[1:]:
        draft.bind(name, omega_c=f"{filters[0]}.omega_c")
    draft.bypass(filters[0])
    first, second = (draft.instances[name].bindings for name in filters[1:])
    assert first == {}
    assert second == {"omega_c": f"{filters[1]}.omega_c"}
    assert_whole(draft)


def test_a_block_that_was_alone_in_sharing_has_its_own_parameter():
    draft = draft_of()
    draft.bind("q_loop", kP="p_loop.kP", kI="p_loop.kI")
    draft.unbind("p_loop", "kP", "kI")
    draft.remove("p_loop")
    assert draft.instances["q_loop"].bindings == {}


def test_a_new_block_has_nothing_in_common_with_a_dead_one_of_its_name():
    draft = draft_of()
    for name in (
        "q_loop",
        draft.insert("pll.delta_omega", ["decoupling.delta_omega"], "PI", "third"),
    ):
        draft.bind(name, kP="p_loop.kP", kI="p_loop.kI")
    draft.unbind("p_loop", "kP", "kI")
    draft.remove("p_loop")
    assert draft.add("PI", "p_loop") == "p_loop"
    shared = [value for one in draft.instances.values() for value in one.bindings.values()]
    assert not any(str(value).startswith("p_loop.") for value in shared)
    assert len(set(shared)) == 2  # kP and kI of the two that are left


def test_a_parameter_is_handed_on_to_the_exchanged_block_where_it_means_the_same():
    draft = draft_of("gfl_l_filter")
    draft.bind("decoupling", L="plant.L_F")
    draft.rename(draft.replace("plant", "LCL", "other"), "plant")
    assert draft.instances["decoupling"].bindings == {"L": "plant.L_F"}


def test_a_parameter_of_another_unit_is_not_handed_on():
    draft = draft_of("gfl")
    twin = draft.insert("plant.e", ["plant.u_r"], "JMul", "twin")
    draft.bind(twin, L="decoupling.L")  # seconds; that of a JMul_omega is per unit
    draft.replace("decoupling", "JMul_omega", "decoupling")
    assert draft.instances[twin].bindings == {}


# tidying


def test_what_nothing_drives_goes_and_takes_its_path_along():
    draft = draft_of()
    draft.remove("power")
    draft.tidy()
    gone = {one.name for one in GFL.instances} - set(draft.instances)
    assert gone == {"power", "minus_p", "p_loop", "q_loop", "i_ref"}
    assert_whole(draft)


def test_the_axis_that_is_left_of_a_vector_gets_a_zero_beside_it():
    draft = draft_of()
    draft.remove("q_loop")
    draft.tidy()
    (source,) = draft.sources("i_ref.in_q")
    assert draft.instances[source.split(".")[0]].kind == "ConstZero"
    assert_whole(draft)


def test_a_zero_goes_where_something_else_drives_too():
    draft = draft_of("naive")
    draft.chain(
        "plant.e_q", f"{draft.add('SRF_PLL', 'pll')}.e_q", "pll.delta_omega", "plant.delta_omega"
    )
    draft.tidy()
    assert draft.named("ConstZero") == []
    assert draft.sources("plant.delta_omega") == ["pll.delta_omega"]


def test_a_plant_without_a_frequency_gets_zero():
    draft = draft_of("naive")
    draft.remove("no_frequency")
    draft.tidy()
    assert same(draft.diagram(), ibrid.textbook("naive"))


def test_a_module_without_a_way_out_goes():
    draft = draft_of("naive")
    draft.connect("plant.e", f"{draft.add('Gain_dq', 'idle')}.in_")
    draft.tidy()
    assert same(draft.diagram(), ibrid.textbook("naive"))


def test_what_cannot_be_made_whole_is_left_to_the_grammar():
    draft = draft_of("naive")
    draft.remove("gain")
    draft.tidy()
    assert [one.reason for one in violations(draft.diagram(), VOCABULARY)] == ["undriven_input"]


@pytest.mark.slow
@each_of("name", ibrid.textbook_names())
def test_whatever_single_block_is_taken_away_tidying_ends_in_a_whole_or_without_a_plant(name):
    for victim in draft_of(name).instances:
        draft = draft_of(name)
        draft.remove(victim)
        draft.tidy()
        reasons = {one.reason for one in violations(draft.diagram(), VOCABULARY)}
        if not reasons:
            assert_whole(draft)
        # without the plant, its command, or the rotation to the terminals there is no inverter
        allowed = {"no_plant", "no_terminal_current", "undriven_input"}
        # of two devices one is left without its share, or a share without a second device
        assert reasons <= allowed | (
            {"several_plants", "share"} if name == "parallel_gfl_gfm" else set()
        ), victim
        again = draft.diagram()
        draft.tidy()
        assert draft.diagram() == again
