"""Two devices behind one PCC: when the grammar allows a second plant, and what each device rests
at.
"""

import re

import numpy as np
import pytest

import ibrid
from ibrid.assembly.equilibrium import equilibria
from ibrid.assembly.symbolic import symbolic_model
from ibrid.errors import DiagramError
from ibrid.fit.kernel import admittance
from ibrid.modules import PAPER_VOCABULARY, VOCABULARY
from ibrid.plants import PLANTS
from ibrid.structure import parse_program, textbook, textbook_text, violations, warnings, wire

OMEGA_0, FREQUENCY = 2 * np.pi * 60, np.geomspace(0.5, 1e4, 25)
TEXT = textbook_text("parallel_gfl_gfm")


def reasons(text: str, vocabulary=VOCABULARY) -> list[str]:
    return [one.reason for one in violations(parse_program(text), vocabulary)]


def without(text: str, *parts: str) -> str:
    """The program without the lines that contain one of the parts."""
    return "".join(
        f"{line}\n" for line in text.splitlines() if not any(part in line for part in parts)
    )


def test_two_devices_that_meet_at_the_outer_ports_alone_are_legal_without_a_warning():
    assert violations(textbook("parallel_gfl_gfm")) == warnings(textbook("parallel_gfl_gfm")) == ()


def test_the_devices_of_a_diagram_are_its_parts_with_a_plant():
    first, second = wire(textbook("parallel_gfl_gfm"), VOCABULARY).devices
    assert (first.plant, second.plant) == ("gfl_plant", "gfm_plant")
    assert all(name.startswith("gfl_") for name in first.kinds)
    assert all(name.startswith("gfm_") for name in second.kinds)
    assert (first.sources["i_DQ"], second.sources["i_DQ"]) == (
        ("gfl_park_i.i_DQ",),
        ("gfm_park_i.i_DQ",),
    )
    one = wire(textbook("gfl"), VOCABULARY)
    assert one.devices == (one,)


def test_a_shunt_at_the_pcc_belongs_to_the_first_device():
    text = (
        TEXT + '    g.add("Shunt_RC", "cable")\n    g.connect("v_DQ", "cable.v")\n    '
        'g.connect("cable.i", "i_DQ")\n'
    )
    assert reasons(text) == []
    first, second = wire(parse_program(text), VOCABULARY).devices
    assert "cable" in first.kinds
    assert "cable" not in second.kinds


def test_plants_that_are_connected_to_each_other_are_refused():
    assert reasons(TEXT + '    g.connect("gfl_plant.e", "gfm_current.in_")\n') == ["several_plants"]


def test_two_plants_without_a_share_are_refused():
    text = without(TEXT, '"Share"', "gfl_share.v_DQ").replace("gfl_share.v", "v_DQ")
    (found,) = violations(parse_program(text))
    assert found.reason == "several_plants"
    assert "through a Share: found 0" in found.message


def test_the_papers_vocabulary_keeps_to_one_plant():
    text = without(
        TEXT,
        '"Share"',
        "gfl_share.v_DQ",
        "JMul_omega",
        "decoupling",
        "virtual_reactance",
        "minus_drop",
    )
    assert reasons(text.replace("gfl_share.v", "v_DQ"), PAPER_VOCABULARY) == ["several_plants"]


def test_a_share_beside_one_plant_and_a_share_of_another_signal_are_refused():
    alone = textbook_text("gfl").replace(
        'g.connect("v_DQ", "park_v.v_DQ")', 'g.connect("share.v", "park_v.v_DQ")'
    )
    alone = alone.rstrip() + '\n    g.add("Share", "share")\n    g.connect("v_DQ", "share.v_DQ")\n'
    assert reasons(alone) == ["share"]
    elsewhere = TEXT.replace(
        'g.connect("v_DQ", "gfl_share.v_DQ")', 'g.connect("gfl_plant.i_g", "gfl_share.v_DQ")'
    )
    elsewhere = elsewhere.replace(
        'g.connect("gfl_share.v", "gfl_park_v.v_DQ")', 'g.connect("v_DQ", "gfl_park_v.v_DQ")'
    )
    assert "share" in reasons(elsewhere)


def response(diagram, values, point, node: str) -> np.ndarray:
    """(K, 2, 2) at given values and an operating point (p, q, v)."""
    model = symbolic_model(
        wire(diagram, VOCABULARY), equilibrium="exact", power_node=node, omega_0=OMEGA_0
    )
    theta = [values[parameter.name] for parameter in model.parameters]
    return admittance(model, theta, point, 2 * np.pi * FREQUENCY)


def copy_of(name: str, prefix: str, entry: str = "v_DQ") -> str:
    """The lines of a textbook program with other names; the terminal voltage comes from `entry`."""
    lines = [line for line in textbook_text(name).splitlines() if line.startswith("    g.")]
    renamed = re.sub(r'"(?!v_DQ"|i_DQ")([a-z_]\w*[."])', rf'"{prefix}\1', "\n".join(lines))
    return renamed.replace('("v_DQ"', f'("{entry}"') + "\n"


@pytest.mark.slow
@pytest.mark.parametrize("node", ["capacitor", "pcc"])
@pytest.mark.parametrize("point", [(1.0, 0.3, 1.0), (-0.6, 0.1, 1.04)])
def test_two_equal_devices_that_share_by_halves_have_twice_the_admittance_of_one_at_half_the_power(
    node, point
):
    plant = PLANTS["paper_like"].with_overrides({"omega_c_pll": 2000.0})
    (p, q, v), name = point, "gfl_pll_filter_exact"
    text = 'def pair(g):\n    g.add("Share", "half")\n    g.connect("v_DQ", "half.v_DQ")\n'
    pair = parse_program(text + copy_of(name, "a_", "half.v") + copy_of(name, "b_"))
    assert violations(pair) == ()
    values = {
        f"{prefix}_{key}": value for prefix in "ab" for key, value in plant.diagram_values.items()
    }
    found = response(pair, values | {"half.share_p": 0.5, "half.share_q": 0.5}, point, node)
    alone = response(textbook(name), plant.diagram_values, (p / 2, q / 2, v), node)
    np.testing.assert_allclose(found, 2 * alone, rtol=1e-9, atol=1e-12)


def test_one_frame_is_not_asked_of_two_devices():
    diagram = wire(textbook("parallel_gfl_gfm"), VOCABULARY)
    with pytest.raises(DiagramError, match="two devices, each with its own frame"):
        equilibria(diagram, {}, (1.0, 0.3, 1.0), "pcc", OMEGA_0)


@pytest.mark.nightly
def test_the_linear_model_of_two_devices_is_as_any_other():
    record = ibrid.evaluate(
        textbook("parallel_gfl_gfm"), ibrid.read_sweep(ibrid.benchmarks()["parallel_gfl_gfm"])
    )
    system = record.state_space("p=1,q=0.3")
    assert system.nstates == 23
    assert np.real(system.poles()).max() < 0
