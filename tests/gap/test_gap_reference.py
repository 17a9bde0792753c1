"""The gap workflow on grid-forming inverters and on two devices: what it starts from, and what it
understands of them.
"""

from math import log

import pytest

import ibrid
from ibrid.gap.datasets.sweep_dataset import SweepDataset
from ibrid.gap.refitting.noise import estimate_noise
from ibrid.gap.refitting.prior import build_prior
from ibrid.gap.workflow import find_gap
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import CATALOGUE, insertions
from ibrid.parts.editing.view import views_of
from ibrid.plants import PLANTS
from ibrid.structure import parameter_table, parse_program, textbook, violations, wire
from ibrid.structure.editing.drafting import Draft


def without_virtual_reactance() -> ibrid.Diagram:
    draft = Draft(textbook("gfm_droop"), VOCABULARY)
    draft.remove("virtual_reactance")
    draft.tidy()
    return draft.diagram()


def effects(*ids: str):
    return tuple(one for one in CATALOGUE if one.id in ids)


# what it starts from


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["gfm_vsm", pytest.param("parallel_gfl_gfm", marks=pytest.mark.nightly)]
)
def test_without_nominal_values_the_textbook_program_explains_its_own_device(name):
    sweep, diagram = ibrid.read_sweep(ibrid.benchmarks()[name]), parse_program(PLANTS[name].program)
    dataset = SweepDataset(estimate_noise(sweep), VOCABULARY, {}, CATALOGUE, 0)
    given = dataset.fit_given(diagram)
    assert given is not None
    assert given.is_adequate()
    # draws about typical values alone end elsewhere
    alone = dataset.fitter_for(given.convention).fit(diagram, [{}], draws=16)
    assert alone is not None
    assert alone.chi2 > 10 * alone.measurement_count


def test_the_tolerance_of_a_large_negative_gain_is_a_part_of_its_size():
    wiring = wire(textbook("gfm_droop"), VOCABULARY)
    prior = build_prior(
        {"p_droop.k": -15.7, "q_droop.k": -0.2, "damping.k": {"value": -8.0, "tolerance": 1.0}},
        wiring,
        parameter_table(wiring, "exact"),
    )
    assert prior["p_droop.k"].tolerance == pytest.approx(15.7 * log(2.0))
    assert prior["q_droop.k"].tolerance == 0.25
    assert prior["damping.k"].tolerance == 1.0


# what it understands


def test_a_virtual_reactance_with_the_controllers_frequency_is_seen_and_no_decoupling_for_it():
    found = insertions(
        textbook("gfm_droop"), VOCABULARY, effects("virtual_impedance", "decoupling")
    )
    removed = [
        one.where for one in found if one.effect == "virtual_impedance" and one.change == "remove"
    ]
    assert removed == ["virtual_reactance, plant.i_g to the voltage reference at voltage.in_"]
    exchanged = [
        one for one in found if one.effect == "virtual_impedance" and one.change == "replace"
    ]
    assert [one.parameters.keys() for one in exchanged] == [{"virtual_reactance_nominal.L"}]
    assert all("virtual_reactance" not in one.where for one in found if one.effect == "decoupling")


@pytest.mark.nightly
def test_a_missing_virtual_reactance_is_named_in_the_form_that_the_device_has():
    sweep, values = (
        ibrid.read_sweep(ibrid.benchmarks()["gfm_droop"]),
        dict(PLANTS["gfm_droop"].diagram_values),
    )
    model = without_virtual_reactance()
    nominal = {
        name: 1.1 * value for name, value in values.items() if not name.startswith("virtual")
    }
    gap = find_gap(
        model,
        sweep,
        nominal,
        catalogue=effects("virtual_impedance", "control_delay", "power_filter"),
    )
    assert gap.verdict == "named", gap.sentence
    (found,) = gap.effects
    assert found.id == "virtual_impedance"
    assert "JMul_omega" in found.where
    assert found.parameters["virtual_reactance.L"][0] == pytest.approx(
        values["virtual_reactance.L"], rel=0.05
    )


# two devices


def test_each_of_two_devices_is_looked_at_by_itself():
    first, second = views_of(textbook("parallel_gfl_gfm"), VOCABULARY)
    assert (first.roles.plant, second.roles.plant) == ("gfl_plant", "gfm_plant")
    assert (first.roles.frequency, second.roles.frequency) == ("gfl_pll", "gfm_p_droop")
    whole = {instance.name for instance in textbook("parallel_gfl_gfm").instances}
    assert not set(first.draft.instances) & set(second.draft.instances)
    assert {*first.draft.instances, *second.draft.instances} == whole - {"gfl_share"}
    assert second.draft.named("SRF_PLL", "Rot_v") == ["gfm_park_v"]


@pytest.mark.slow
def test_an_edit_of_one_device_leaves_the_other_alone():
    before = textbook("parallel_gfl_gfm")
    devices = views_of(before, VOCABULARY)
    kept = {one.name: one for one in before.instances}
    for number, model in enumerate(devices):
        for effect in CATALOGUE:
            for one in effect.insertions(model):
                if violations(one.diagram, VOCABULARY):
                    continue
                other = devices[1 - number].draft.instances
                after = {each.name: each for each in one.diagram.instances}
                assert all(after.get(name) == kept[name] for name in other), (
                    f"{one.effect}: {one.where}"
                )


def test_each_device_of_two_may_lack_its_own_delay_and_the_shunt_comes_once():
    found = insertions(
        textbook("parallel_gfl_gfm"), VOCABULARY, effects("control_delay", "shunt_capacitance")
    )
    assert [one.where for one in found if one.effect == "control_delay"] == [
        "before gfl_plant.u_r, on all that drives it",
        "before gfm_plant.u_r, on all that drives it",
    ]
    assert sum(one.effect == "shunt_capacitance" for one in found) == 1
