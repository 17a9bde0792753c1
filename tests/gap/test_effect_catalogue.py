"""The catalogue of effects: every edit is legal, does nothing at nothing and something at a
strength, and can be undone.
"""

import pickle
import re
import zlib
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from effects_page import effects_table

from ibrid.assembly.interconnection import interconnect_rows
from ibrid.assembly.modules_at import module_matrices
from ibrid.modules import PAPER_VOCABULARY, VOCABULARY
from ibrid.modules.behaviour import Element
from ibrid.parts import Edit, Effect, Insertion, Move, Strength, view_of
from ibrid.parts.catalogue import CATALOGUE, insertions
from ibrid.structure import (
    Diagram,
    compare,
    parameter_table,
    parse_program,
    program_text,
    structure_hash,
    textbook,
    textbook_names,
    textbook_text,
    violations,
    warnings,
    wire,
)
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.reading.parameters import parameters_at

OMEGA_0 = 2 * np.pi * 60
FREQUENCY = np.geomspace(1.0, 5000.0, 13)
POINT = (0.9, 0.3, 1.0)
#: The ids that results and benchmarks refer to; more are welcome, these stay.
IDS = (
    "control_delay",
    "pll_missing",
    "power_loop_missing",
    "reactive_loop_missing",
    "pll_prefilter",
    "power_filter",
    "current_filter",
    "voltage_feedforward",
    "voltage_feedforward_filter",
    "decoupling",
    "active_damping",
    "ac_voltage_loop",
    "dc_link",
    "frequency_droop",
    "virtual_impedance",
    "series_impedance",
    "shunt_capacitance",
    "capacitor_damping",
    "filter_capacitor",
    "frame_misalignment",
)
NAMES = textbook_names()
ALL = {name: insertions(textbook(name), VOCABULARY) for name in NAMES}
EVERY = [
    pytest.param(name, one, id=f"{name}: {one.effect}, {one.change} {one.where}")
    for name in NAMES
    for one in ALL[name]
]


def response(diagram: Diagram, given: dict[str, float]) -> np.ndarray:
    """(K, 2, 2) at values near typical ones, the same for the same name, and at given ones; delays
    exact.
    """
    wiring = wire(diagram, VOCABULARY)
    table = parameter_table(wiring, "exact")
    values = {
        one.name: one.typical * (0.7 + 0.6 * zlib.crc32(one.name.encode()) / 2**32)
        for one in table.free
    } | given
    matrices = module_matrices(
        wiring,
        parameters_at(wiring, table, values),
        POINT,
        equilibrium="exact",
        power_node="capacitor",
        omega_0=OMEGA_0,
    )
    joined = interconnect_rows(wiring, matrices, exact_delays=True)
    whole = np.zeros((joined.size + 2, joined.size + 2))
    for i, row in enumerate(joined.rows):
        for j, value in row.items():
            whole[i, j] = value
    n = joined.size
    bound = [table.of(name, str(wiring.kinds[name].delay)) for name, _ in joined.delayed]
    delays = np.array([values[one] if isinstance(one, str) else one for one in bound])
    found = []
    for s in 2j * np.pi * FREQUENCY:
        left = (
            np.diag(np.concatenate([np.full(len(joined.states), s), np.exp(s * delays)]))
            - whole[:n, :n]
        )
        found.append(whole[n:, :n] @ np.linalg.solve(left, whole[:n, n:]) + whole[n:, n:])
    return np.array(found)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest over the frequencies, relative to the first's largest entry there."""
    return float((np.abs(one - other).max(axis=(1, 2)) / np.abs(one).max(axis=(1, 2))).max())


def free_units(diagram: Diagram) -> dict[str, str]:
    return {one.name: one.unit for one in parameter_table(wire(diagram, VOCABULARY), "exact").free}


def of(name: str, effect: str, change: str | None = None) -> list[Insertion]:
    return [one for one in ALL[name] if one.effect == effect and change in (None, one.change)]


def effect(name: str) -> Effect:
    (found,) = [one for one in CATALOGUE if one.id == name]
    return found


# the catalogue as a whole


def test_every_effect_that_results_refer_to_is_in_the_catalogue_once():
    ids = [one.id for one in CATALOGUE]
    assert set(IDS) <= set(ids)
    assert len(ids) == len(set(ids))


@each_of("one", CATALOGUE, ids=lambda one: one.id)
def test_what_an_effect_is_confused_with_is_an_effect_that_is_confused_with_it(one):
    assert one.confused_with
    for other in one.confused_with:
        assert one.id in effect(other).confused_with, f"{other} does not name {one.id}"


@each_of("one", CATALOGUE, ids=lambda one: one.id)
def test_an_effect_of_the_device_changes_some_textbook_program_and_one_of_the_measurement_none(one):
    assert any(of(name, one.id) for name in NAMES) != one.measurement


@pytest.mark.slow
@each_of("one", CATALOGUE, ids=lambda one: one.id)
def test_an_effect_travels_to_another_process(one):
    again = pickle.loads(pickle.dumps(one))
    assert again == one
    assert len(insertions(textbook("gfl"), VOCABULARY, (again,))) == len(of("gfl", one.id))


@pytest.mark.slow
def test_the_table_for_people_is_that_of_the_catalogue():
    page = (
        Path(__file__)
        .resolve()
        .parents[2]
        .joinpath("docs", "effects.md")
        .read_text(encoding="utf-8")
    )
    table = effects_table(CATALOGUE)
    assert table in page, (
        "docs/effects.md: put in what effects_table(CATALOGUE) of docs/making/effects_page.py "
        "returns"
    )
    assert page.count("\n| `") == len(CATALOGUE)
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(compile(example, "docs/effects.md", "exec"), {})


def test_what_an_effect_says_of_a_pll_and_a_delay_is_a_sentence():
    said = {
        one.where: one.says
        for name in ("gfl", "gfl_delay")
        for one in insertions(textbook(name), VOCABULARY, CATALOGUE)
    }
    assert said["SRF_PLL_P in place of the SRF_PLL pll"] == (
        "the PLL pll of the device has no integral action, so that it rests with e_q = e_q_ref, "
        "(omega - omega_pll)/kP_pll, "
        "while that of the model has integral action, so that it rests with e_q = 0"
    )
    assert said["delay as a Pade form of order 2"] == (
        "the device approximates its delay by a Pade form of order 2, where the model has it exact"
    )
    assert r"$\frac{1 - \frac{s\,T_{d}}{2}}{1 + \frac{s\,T_{d}}{2}}$" in effects_table(CATALOGUE)


# every edit of every textbook program


@pytest.mark.nightly
@each_of(("name", "one"), EVERY)
def test_an_edit_gives_a_legal_program_that_reads_back_and_keeps_the_users_names(name, one):
    before = textbook(name)
    assert violations(one.diagram) == ()
    assert warnings(one.diagram) == ()
    assert parse_program(program_text(one.diagram)) == one.diagram
    assert one.diagram.name == before.name
    kinds = {instance.name: instance.kind for instance in before.instances}
    plants = {each.plant for each in wire(before, VOCABULARY).devices}
    assert plants <= {instance.name for instance in one.diagram.instances}
    assert one.where
    draft = Draft(before, VOCABULARY)
    kept = plants.union(draft.having(Element.PLL))  # their numbers go on under their names
    for instance in (
        one.diagram.instances
    ):  # a name that is used again stands for the same kind, a plant, a PLL or a form
        same = kinds.get(instance.name, instance.kind) == instance.kind
        assert same or instance.name in kept or one.form


@pytest.mark.slow
@each_of(("name", "one"), EVERY)
def test_the_new_parameters_are_declared_with_their_strengths_and_the_others_mean_what_they_meant(
    name, one
):
    before, after = free_units(textbook(name)), free_units(one.diagram)
    assert one.parameters.keys() == after.keys() - before.keys()
    assert one.nothing.keys() <= one.parameters.keys()
    assert {key: before[key] for key in before.keys() & after.keys()} == {
        key: after[key] for key in before.keys() & after.keys()
    }
    assert len({len(bank) for bank in one.parameters.values()}) <= 1
    boxes = {
        each.name: each for each in parameter_table(wire(one.diagram, VOCABULARY), "exact").free
    }
    for key, bank in one.parameters.items():
        assert len(bank) >= 3
        assert all(boxes[key].low <= value <= boxes[key].high for value in bank)


@pytest.mark.nightly
@each_of(("name", "one"), EVERY)
def test_an_edit_does_nothing_at_nothing_and_something_at_each_strength(name, one):
    given = response(textbook(name), {})
    for j in range(max((len(bank) for bank in one.parameters.values()), default=1)):
        strength = {key: bank[j] for key, bank in one.parameters.items()}
        # far above rounding, far below what an effect that anyone looks for does; a form of high
        # order does less
        assert difference(given, response(one.diagram, strength)) > (1e-9 if one.form else 1e-4)
        if one.nothing:
            assert difference(given, response(one.diagram, {**strength, **one.nothing})) < 1e-6


@pytest.mark.slow
@each_of("name", NAMES)
def test_each_structure_comes_once_and_the_given_one_never(name):
    hashes = [structure_hash(one.diagram) for one in ALL[name]]
    assert len({*hashes, structure_hash(textbook(name))}) == len(hashes) + 1


@pytest.mark.nightly
@each_of(("name", "one"), [case for case in EVERY if case.values[1].change == "add"])  # type: ignore[union-attr]
def test_what_an_effect_added_it_can_take_away_again(name, one):
    wanted = structure_hash(textbook(name))
    back = [
        again
        for again in insertions(one.diagram, VOCABULARY, (effect(one.effect),))
        if again.change == "remove"
    ]
    assert wanted in [structure_hash(again.diagram) for again in back]


@pytest.mark.slow
@each_of(("name", "one"), [case for case in EVERY if case.values[1].change == "remove"])  # type: ignore[union-attr]
def test_what_an_effect_took_away_it_can_put_in_again(name, one):
    again = insertions(one.diagram, VOCABULARY, (effect(one.effect),))
    assert {each.change for each in again} & {"add", "replace"}


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["gfl_delay", "gfl_l_filter", "gfl_pll_filter"])
def test_a_second_edit_on_top_of_any_first_is_legal_too(name):
    for one in ALL[name]:
        model = view_of(one.diagram, VOCABULARY)
        assert model is not None
        for each in CATALOGUE:
            for second in each.insertions(model):
                assert violations(second.diagram) == (), f"{one.where}, then {second.where}"


def test_the_textbook_inverter_has_some_fifty_edits_at_all_the_usual_places():
    found = {(one.effect, one.change) for one in ALL["gfl_pll_filter"]}
    assert len(ALL["gfl_pll_filter"]) >= 45
    assert {("pll_prefilter", change) for change in ("add", "remove", "replace")} <= found
    assert {("decoupling", "remove"), ("decoupling", "replace"), ("dc_link", "replace")} <= found
    assert [
        len(of("gfl_pll_filter", one))
        for one in ("current_filter", "virtual_impedance", "frequency_droop")
    ] == [
        2,
        3,
        2,
    ]


# single effects


def program(name: str, *changes: tuple[str, str]) -> Diagram:
    """A textbook program with parts of its text exchanged."""
    text = textbook_text(name)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    diagram = parse_program(text)
    assert violations(diagram) == ()
    return diagram


def test_the_delay_takes_the_whole_command_and_the_dc_link_sees_the_delayed_one():
    (linked,) = of("gfl_exact", "dc_link")
    (delayed,) = insertions(linked.diagram, VOCABULARY, (effect("control_delay"),))
    sources = wire(delayed.diagram, VOCABULARY).sources
    assert sources["plant.u_r"] == sources["dc_link.u"] == ("delay.out",)
    assert set(sources["delay.in_"]) == {"current.out", "decoupling.out", "plant.e"}


def test_a_path_joins_the_command_before_its_delay():
    for one in of("gfl_delay", "active_damping"):
        assert wire(one.diagram, VOCABULARY).sources["plant.u_r"] == ("delay.out",)
    assert {one.change for one in of("gfl_delay", "control_delay")} == {"remove"}


def test_removing_the_delay_or_the_filter_of_a_program_gives_the_program_without_it():
    for name, without, what in (
        ("gfl_delay", "gfl_exact", "control_delay"),
        ("gfl_pll_filter", "gfl", "pll_prefilter"),
        ("gfl_power_filter", "gfl_exact", "power_filter"),
    ):
        assert structure_hash(textbook(without)) in [
            structure_hash(one.diagram) for one in of(name, what, "remove")
        ]
        assert structure_hash(textbook(name)) in [
            structure_hash(one.diagram) for one in of(without, what, "add")
        ]


def test_exchanging_the_decoupling_gives_the_program_with_the_other_one():
    for name, other in (("gfl", "gfl_exact"), ("gfl_pll_filter_exact", "gfl_pll_filter")):
        (found,) = of(name, "decoupling", "replace")
        assert structure_hash(found.diagram) == structure_hash(textbook(other))


def test_without_the_pll_a_decoupling_by_its_frequency_keeps_its_inductance():
    for one in of("gfl_exact", "pll_missing", "remove"):
        assert "decoupling.L" in free_units(one.diagram)
        assert "pll.kP_pll" not in free_units(one.diagram)


def test_a_loop_that_is_put_in_may_share_the_gains_of_the_other():
    (removed,) = of("gfl", "reactive_loop_missing", "remove")
    again = insertions(removed.diagram, VOCABULARY, (effect("reactive_loop_missing"),))
    assert [sorted(one.parameters) for one in again] == [["q_loop.kI", "q_loop.kP"], []]
    assert structure_hash(again[1].diagram) == structure_hash(textbook("gfl"))


def test_a_filter_of_p_and_q_and_one_of_the_current_reference_are_the_same_admittance():
    (both, *_), (reference,) = (
        of("gfl", "power_filter", "add"),
        of("gfl", "reference_filter", "add"),
    )
    (one,), (other,) = both.parameters, reference.parameters
    found = response(both.diagram, {one: 300.0}), response(reference.diagram, {other: 300.0})
    assert difference(*found) < 1e-10


def test_a_line_behind_an_lcl_is_taken_up_by_its_grid_side_and_behind_an_l_filter_it_is_an_effect():
    line = effect("series_impedance")
    for name, absorbed, changes in (
        ("gfl", ("plant.L_g", "plant.R_g"), []),
        ("gfl_l_filter", (), ["add"]),
        ("naive", ("plant.L_F", "plant.R_F"), []),
    ):
        model = view_of(textbook(name), VOCABULARY)
        assert model is not None
        assert line.absorbed(model) == absorbed
        assert [one.change for one in of(name, "series_impedance")] == changes


def test_a_grid_side_that_the_user_fixed_is_set_free_for_a_line():
    fixed = program("gfl", ('"LCL", "plant"', '"LCL", "plant", L_g=0.1, R_g=0.01'))
    (found,) = insertions(fixed, VOCABULARY, (effect("series_impedance"),))
    assert found.nothing == {"plant.L_g": 0.1, "plant.R_g": 0.01}
    assert structure_hash(found.diagram) == structure_hash(textbook("gfl"))


def test_a_line_that_is_absorbed_takes_the_shared_name_and_not_a_fixed_number():
    fixed = program("gfl", ('"LCL", "plant"', '"LCL", "plant", L_g=0.1, R_g="R_line"'))
    model = view_of(fixed, VOCABULARY)
    assert model is not None
    assert effect("series_impedance").absorbed(model) == ("R_line",)


def test_another_plant_keeps_what_the_user_fixed_and_shared():
    given = program(
        "gfl", ('"LCL", "plant"', '"LCL", "plant", L_F=0.15, C_F=(0.01, 0.1), R_F="R", R_g="R"')
    )
    for one in insertions(
        given, VOCABULARY, (effect("capacitor_damping"), effect("filter_capacitor"))
    ):
        (plant,) = [instance for instance in one.diagram.instances if instance.name == "plant"]
        assert plant.bindings["L_F"] == 0.15
        assert plant.bindings["R_F"] == "R"
        assert plant.bindings.get("C_F", (0.01, 0.1)) == (0.01, 0.1)


def test_active_damping_that_is_drawn_as_a_difference_of_currents_is_recognised():
    drawn = program(
        "gfl",
        (
            '    g.connect("park_i.i_DQ", "i_DQ")',
            '    g.connect("park_i.i_DQ", "i_DQ")\n    g.add("Gain_dq", "mine", k=-0.2)\n'
            '    g.add("Negate_dq", "minus_i_g")\n    g.connect("plant.i_g", "minus_i_g.in_")\n'
            '    g.connect("plant.i_ti", "mine.in_")\n    g.connect("minus_i_g.out", "mine.in_")\n'
            '    g.connect("mine.out", "plant.u_r")',
        ),
    )
    (found,) = insertions(drawn, VOCABULARY, (effect("active_damping"),))
    assert found.change == "remove"
    assert structure_hash(found.diagram) == structure_hash(textbook("gfl"))
    assert not [
        one
        for one in insertions(drawn, VOCABULARY, (effect("virtual_impedance"),))
        if one.change == "remove"
    ]


def test_a_droop_with_a_negative_gain_is_recognised():
    drawn = program(
        "gfl",
        (
            '    g.connect("park_i.i_DQ", "i_DQ")',
            '    g.connect("park_i.i_DQ", "i_DQ")\n    g.add("LPF1", "slow")\n    g.add("Gain", '
            '"droop")\n'
            '    g.connect("pll.delta_omega", "slow.in_")\n    g.connect("slow.out", "droop.in_")\n'
            '    g.connect("droop.out", "p_loop.in_")',
        ),
    )
    found = insertions(drawn, VOCABULARY, (effect("frequency_droop"),))
    assert [one.change for one in found] == ["remove", "replace"]
    assert structure_hash(found[0].diagram) == structure_hash(textbook("gfl"))


def test_a_controller_of_the_grid_current_is_filtered_where_it_measures():
    (moved,) = [
        one
        for one in of("gfl", "current_sensor")
        if one.where.endswith("for current loop and decoupling")
    ]
    sources = wire(moved.diagram, VOCABULARY).sources
    assert sources["minus_i.in_"] == sources["decoupling.in_"] == ("plant.i_g",)
    together, _ = insertions(moved.diagram, VOCABULARY, (effect("current_filter"),))
    assert wire(together.diagram, VOCABULARY).sources["current_filter.in_"] == ("plant.i_g",)


def test_an_lcl_in_place_of_an_l_filter_is_controlled_by_either_current():
    converter, grid = (
        wire(one.diagram, VOCABULARY).sources for one in of("gfl_l_filter", "filter_capacitor")
    )
    assert (converter["minus_i.in_"], grid["minus_i.in_"]) == (("plant.i_ti",), ("plant.i_g",))
    assert converter["power.i"] == grid["power.i"] == converter["park_i.i_dq"] == ("plant.i_g",)


def test_the_negative_sequence_gets_the_filtered_reference_and_the_gains_of_the_current_loop():
    shared, own = of("gfl", "negative_sequence_control")
    sources = wire(shared.diagram, VOCABULARY).sources
    assert set(sources["negative_sequence.in_"]) == {"negative_reference.out", "minus_i.out"}
    assert sources["negative_reference.in_"] == ("i_ref.out",)
    assert "negative_sequence.out" in sources["plant.u_r"]
    assert set(shared.parameters) == {"negative_reference.omega_c"}
    assert set(own.parameters) == {"negative_sequence.kP", "negative_sequence.kI"}


def test_the_negative_sequence_with_shared_gains_takes_the_current_before_its_filter():
    filtered, _ = of("gfl", "current_filter")
    shared, own = insertions(filtered.diagram, VOCABULARY, (effect("negative_sequence_control"),))
    sources = wire(shared.diagram, VOCABULARY).sources
    (sign,) = set(sources["negative_sequence.in_"]) - {"negative_reference.out"}
    assert sources[sign.replace(".out", ".in_")] == ("plant.i_ti",)
    beside = wire(own.diagram, VOCABULARY).sources
    assert beside["negative_sequence.in_"] == beside["current.in_"]


def test_one_axis_of_the_reference_may_follow_its_power_while_the_other_keeps_its_loop():
    active, reactive, *_ = of("gfl", "power_reference")
    for edit, gone, kept in ((active, "p_loop", "q_loop"), (reactive, "q_loop", "p_loop")):
        wiring = wire(edit.diagram, VOCABULARY)
        assert gone not in wiring.kinds
        assert kept in wiring.kinds
        assert wiring.sources["references.v"] == ("reference_filter.out",)
    assert wire(active.diagram, VOCABULARY).sources["i_ref.in_d"] == ("reference_d.out",)
    assert wire(reactive.diagram, VOCABULARY).sources["i_ref.in_q"] == ("reference_q.out",)


def test_references_take_the_positive_sequence_that_the_pll_has_or_one_of_their_own():
    opened = textbook("gfl_open_loop")
    edits = {
        edit.where: wire(edit.diagram, VOCABULARY).sources
        for edit in insertions(opened, VOCABULARY, (effect("power_reference"),))
        if edit.change == "add"
    }
    own, both = (edits[f"DSOGI_dq on the voltage of {one}i_ref"] for one in ("", "pll and "))
    assert own["e_filter.in_"] == ("reference_sequence.out",)
    assert own["pll.e_q"] == ("plant.e_q",)
    assert both["e_filter.in_"] == both["pll_q.in_"] == ("sequence.out",)
    (locked,) = (
        edit.diagram
        for edit in insertions(opened, VOCABULARY, (effect("pll_sequence_filter"),))
        if edit.where == "DSOGI_dq on the voltage to which pll locks"
    )
    shared = [
        wire(edit.diagram, VOCABULARY).sources["e_filter.in_"]
        for edit in insertions(locked, VOCABULARY, (effect("power_reference"),))
        if edit.where == "the output of pll_sequence at i_ref"
    ]
    assert shared == [("pll_sequence.out",)]


def test_one_axis_gets_a_loop_while_the_other_keeps_its_reference_from_power():
    edits = {
        edit.where: edit.diagram
        for edit in insertions(
            textbook("gfl_dual_current"), VOCABULARY, (effect("power_reference"),)
        )
    }
    sources = wire(edits["a loop of q on in_q in place of that axis of i_ref"], VOCABULARY).sources
    assert sources["reference.in_q"] == ("q_loop.out",)
    assert sources["q_loop.in_"] == ("power.q",)
    assert sources["reference.in_d"] == ("reference_p.out",)
    assert "reference.out" in sources["current.in_"]
    assert "reference.out" in sources["negative.in_"]
    assert "i_ref.out" not in sources["current.in_"]


def test_what_filters_the_voltage_of_the_references_is_put_in_and_taken_out():
    plain = textbook("gfl_open_loop")
    (without,) = (
        edit.diagram
        for edit in insertions(plain, VOCABULARY, (effect("power_reference"),))
        if edit.where == "e_filter on the way to i_ref"
    )
    again = insertions(without, VOCABULARY, (effect("power_reference"),))
    assert structure_hash(plain) in [structure_hash(edit.diagram) for edit in again]
    shared = textbook("gfl_ddsrf_open_loop")
    (parted,) = (
        wire(edit.diagram, VOCABULARY).sources
        for edit in insertions(shared, VOCABULARY, (effect("power_reference"),))
        if edit.where == "sequence_filter on the way to i_ref"
    )
    assert parted["i_ref.v"] == ("double_frame.out",)
    assert parted["sequence_q.in_"] == ("sequence_filter.out",)


# what users bring


def test_an_edit_needs_no_kind_that_the_vocabulary_leaves_out():
    found = insertions(textbook("gfl"), PAPER_VOCABULARY)
    assert found
    assert all(violations(one.diagram, "paper") == () for one in found)
    assert not [
        one for one in found if one.effect in ("control_delay", "dc_link", "shunt_capacitance")
    ]
    bound = program("gfl", ('"LCL", "plant"', '"LCL", "plant", L_g=0.1'))
    assert not insertions(bound, PAPER_VOCABULARY, (effect("capacitor_damping"),))


def test_a_new_module_shares_nothing_with_what_the_user_shares():
    given = program(
        "gfl_delay",
        ('"Delay", "delay"', '"Delay", "late", T_d="delay.T_d"'),
        ("delay.in_", "late.in_"),
        ("delay.out", "late.out"),
    )
    draft = Edit(given, VOCABULARY)
    assert draft.add("Delay", "delay") == "delay_2"
    assert draft.free_name("late") == "late_2"
    assert draft.free_name("power") == "power_2"  # a module, and the owner of kP and kI


def mine(_):
    """A filter that exists, one that does not, an edit without a plant, and one that changes
    nothing.
    """
    for kind in ("LPF1_dq", "Nothing"):

        def edit(draft, kind=kind):
            corner = Strength((3000.0, 1000.0, 300.0), 1e14)
            draft.insert_before("park_i.i_dq", kind, "mine", omega_c=corner)

        yield Move.at("add", f"{kind} before park_i.i_dq", edit)
    yield Move.at("remove", "the plant", lambda draft: draft.remove("plant"))
    yield Move.at("replace", "nothing at all", lambda draft: None)


@pytest.mark.slow
def test_own_effects_are_tried_beside_the_catalogue_and_illegal_or_equal_ones_left_out():
    own = Effect("mine", "", "", "", (), "", mine)
    found = insertions(textbook("gfl"), VOCABULARY, (*CATALOGUE, own))
    assert found[:-1] == ALL["gfl"]
    assert (found[-1].where, found[-1].parameters) == (
        "LPF1_dq before park_i.i_dq",
        {"mine.omega_c": (3000.0, 1000.0, 300.0)},
    )


def test_a_diagram_without_a_plant_has_no_edits():
    assert insertions(Diagram("empty"), VOCABULARY) == ()


def test_the_damping_of_a_capacitor_changes_the_plant_alone():
    for one in of("gfl", "capacitor_damping"):
        found = compare(textbook("gfl"), one.diagram)
        assert found.only_first == found.only_second == ("plant",)
