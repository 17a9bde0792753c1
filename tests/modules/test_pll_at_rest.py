"""A PLL that rests with voltage on its q axis: the frame it makes, beside an inverter written out
and linearised.
"""

from dataclasses import replace
from math import asin, atan2

import numpy as np
import pytest
from collecting import each_of
from off_axis_inverter import OMEGA_0, OffAxisInverter

import ibrid
from ibrid.assembly.equilibrium import equilibria
from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.numeric import closed_loop
from ibrid.assembly.rest import rest
from ibrid.errors import ModuleError, OperatingPointError
from ibrid.evaluation.evaluate import record_at
from ibrid.modules.vocabulary import VOCABULARY, find_kind
from ibrid.structure.diagrams.library import textbook_text
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.structure.reading.wiring import wire
from ibrid.testing import check_kind

FREQUENCY = np.geomspace(0.5, 4000, 25)
POINTS = [(0.9, 0.1, 1.0), (-0.5, 0.3, 1.04), (0.0, -0.4, 0.95)]
SLOWER = 2 * np.pi * 2.0
POINT = (0.8, 0.25, 1.03)


def diagram(kind: str, name: str = "gfl_exact") -> ibrid.Diagram:
    """A shipped diagram with another PLL."""
    return parse_program(textbook_text(name).replace('"SRF_PLL"', f'"{kind}"'))


CASES = {
    "LCL, behind its own frequency": ("gfl_exact", "SRF_PLL_P", OffAxisInverter(slower=SLOWER)),
    "LCL, ahead of it": ("gfl_exact", "SRF_PLL_P", OffAxisInverter(slower=-SLOWER, node="pcc")),
    "L, behind its own frequency": (
        "gfl_l_filter",
        "SRF_PLL_P",
        OffAxisInverter(slower=SLOWER, C_F=0.0, L_g=0.0, R_g=0.0, node="pcc"),
    ),
    "LCL, with a reference": (
        "gfl_exact",
        "SRF_PLL_ref",
        OffAxisInverter(e_q_ref=-0.15, kI_pll=1400.0),
    ),
    "an integral takes the frequency up": (
        "gfl_exact",
        "SRF_PLL_ref",
        OffAxisInverter(e_q_ref=0.1, slower=SLOWER, kI_pll=1400.0),
    ),
}


@pytest.mark.slow
@each_of("case", CASES)
def test_a_diagram_answers_as_the_linearised_inverter(case):
    name, kind, inverter = CASES[case]
    record = record_at(diagram(kind, name), inverter.sweep(POINTS, FREQUENCY), inverter.values)
    assert record.nrmse < 1e-11  # rounding of a solver's rest and of the matrices


def test_the_usual_pll_does_not_answer_as_an_inverter_off_its_axis():
    inverter = OffAxisInverter(slower=SLOWER)
    record = record_at(
        diagram("SRF_PLL"),
        inverter.sweep(POINTS, FREQUENCY),
        {**inverter.values, "pll.kI_pll": 1e-6},
    )
    assert record.nrmse > 0.05


def at_rest(
    kind: str, point: tuple[float, float, float] = POINT, deviation: float = 0.0, **values: float
):
    """Angle of the frame and e in it, from the typical values but for some."""
    wiring = wire(diagram(kind), VOCABULARY)
    table = parameter_table(wiring, "exact")
    typical = {one.name: one.typical for one in table.free} | {
        f"pll.{key}": one for key, one in values.items()
    }
    frame, ports = equilibria(
        wiring, parameters_at(wiring, table, typical), point, "capacitor", OMEGA_0, deviation
    )
    return atan2(frame[1], frame[0]), ports["power"]["e"]


@each_of("e_q_ref", [-0.4, -0.05, 0.0, 0.3])
def test_the_frame_leads_the_voltage_by_the_angle_whose_sine_is_the_static_error(e_q_ref):
    on_the_axis, (size, none) = at_rest("SRF_PLL")
    angle, (e_d, e_q) = at_rest("SRF_PLL_ref", e_q_ref=e_q_ref)
    assert none == pytest.approx(0.0, abs=1e-15)
    assert e_q == pytest.approx(e_q_ref, abs=1e-14)
    assert e_d == pytest.approx((size**2 - e_q_ref**2) ** 0.5, rel=1e-13)
    assert on_the_axis - angle == pytest.approx(asin(e_q_ref / size), abs=1e-13)


def test_a_grid_of_another_frequency_turns_a_frame_without_integral_action_alone():
    faster = 2 * np.pi * 1.5
    _, (_, e_q) = at_rest("SRF_PLL_P", deviation=faster, e_q_ref=0.05, kP_pll=70.0)
    assert e_q == pytest.approx(0.05 + faster / 70.0, abs=1e-14)
    _, (_, e_q) = at_rest("SRF_PLL_ref", deviation=faster, e_q_ref=0.05)
    assert e_q == pytest.approx(0.05, abs=1e-14)


def test_a_low_pass_before_the_pll_leaves_the_frame_where_it_is():
    text = textbook_text("gfl_pll_filter_exact").replace('"SRF_PLL"', '"SRF_PLL_P"')
    wiring = wire(parse_program(text), VOCABULARY)
    table = parameter_table(wiring, "exact")
    values = {one.name: one.typical for one in table.free} | {"pll.e_q_ref": 0.2}
    _, ports = equilibria(wiring, parameters_at(wiring, table, values), POINT, "capacitor", OMEGA_0)
    assert ports["power"]["e"][1] == pytest.approx(0.2, abs=1e-14)


def test_a_voltage_below_the_static_error_has_no_rest():
    wiring = wire(diagram("SRF_PLL_P"), VOCABULARY)
    table = parameter_table(wiring, "exact")
    values = {one.name: one.typical for one in table.free} | {"pll.e_q_ref": 0.5}
    parameters = parameters_at(wiring, table, values)
    physics = {"equilibrium": "exact", "power_node": "capacitor", "omega_0": OMEGA_0}
    assert (
        closed_loop(wiring, module_matrices(wiring, parameters, (0.1, 0.0, 0.6), **physics)).nstates
        == 11
    )
    with pytest.raises(OperatingPointError, match="no real operating point"):
        closed_loop(wiring, module_matrices(wiring, parameters, (0.1, 0.0, 0.4), **physics))


@each_of("kind", ["SRF_PLL_P", "SRF_PLL_ref"])
def test_the_nonlinear_model_rests_there_with_the_reference_it_lost(kind):
    inverter = OffAxisInverter(slower=SLOWER)
    wiring = wire(diagram(kind), VOCABULARY)
    at = rest(
        wiring,
        parameter_table(wiring, "exact"),
        inverter.values,
        POINT,
        power_node="capacitor",
        omega_0=OMEGA_0,
        pade_orders={},
    )
    assert at.references["pll.e_q", 0] == pytest.approx(-inverter.e_q_at_rest(), abs=1e-13)


@each_of("kind", ["SRF_PLL_P", "SRF_PLL_ref"])
def test_their_declaration_keeps_the_contract(kind):
    check_kind(find_kind(kind, VOCABULARY))


def _of_another_number(omega, deviation):
    return omega


def _without_the_frequency(e_q_ref):
    return e_q_ref


def test_where_an_input_rests_is_refused_unless_something_integrates():
    kind = find_kind("SRF_PLL_P", VOCABULARY)
    with pytest.raises(
        ModuleError,
        match=r"takes deviation and parameters .* \(kP_pll, e_q_ref, deviation\), found omega",
    ):
        replace(kind, input_at_rest=_of_another_number)
    with pytest.raises(ModuleError, match="takes deviation and parameters"):
        replace(kind, input_at_rest=_without_the_frequency)
    gain = find_kind("LPF1", VOCABULARY)
    with pytest.raises(ModuleError, match="one scalar input with a pole at zero"):
        replace(gain, input_at_rest=lambda deviation: deviation)
