"""Damped filters, lines, shunts, the DC link and the voltage's magnitude: each equals a nonlinear
inverter, linearised.

The inverter is written out here a second time, as x' = f, 0 = g in CasADi; u_r and e are unknowns
of the algebraic part.
"""

import casadi as ca
import numpy as np
import pytest
from collecting import each_of
from extended_inverters import VALUES, Inverter, M, program
from scipy.optimize import fsolve

from ibrid.assembly.equilibrium import equilibria
from ibrid.assembly.symbolic import symbolic_model
from ibrid.fit.kernel import admittance
from ibrid.modules import VOCABULARY, find_kind
from ibrid.structure import compare, parse_program, violations, wire
from ibrid.structure.reading.parameters import parameter_table

OMEGA_0 = 2 * np.pi * 60
FREQUENCY = np.geomspace(0.5, 1e4, 25)
POINTS = [(1.0, 0.3, 1.0), (-0.6, 0.1, 1.04), (0.5, -0.3, 0.95)]


def diagram_response(inverter: Inverter, point, node: str) -> np.ndarray:
    diagram = parse_program(program(inverter))
    assert violations(diagram) == ()
    model = symbolic_model(
        wire(diagram, VOCABULARY), equilibrium="exact", power_node=node, omega_0=OMEGA_0
    )
    theta = [VALUES[parameter.name] for parameter in model.parameters]
    return admittance(model, theta, point, 2 * np.pi * FREQUENCY)


def turned(z):
    return ca.vertcat(-z[1], z[0])


def nonlinear(inverter: Inverter, node: str):
    """(f, g, i_DQ, conditions on the operating point) as functions of (x, z, references, v_DQ,
    point).
    """
    m, states, rates = M, [], []
    i_DQ_shunt = ca.SX(2, 1)
    v_DQ, z, r, point = (
        ca.SX.sym(name, size) for name, size in (("v_DQ", 2), ("z", 4), ("r", 2), ("point", 3))
    )  # type: ignore[arg-type]
    u_r, e = z[:2], z[2:]

    def state(width: int):
        states.append(ca.SX.sym(f"x{len(states)}", width))  # type: ignore[arg-type]
        return states[-1]

    delta, phi, first, second, gamma = state(1), state(1), state(1), state(1), state(2)
    rotate = ca.vertcat(
        ca.horzcat(ca.cos(delta), ca.sin(delta)), ca.horzcat(-ca.sin(delta), ca.cos(delta))
    )
    v = rotate @ v_DQ
    locked = (e if inverter.pll == "e" else v)[1]
    deviation = m["kP_pll"] * locked + m["kI_pll"] * phi
    omega = OMEGA_0 + deviation
    i_g = state(2)
    lcl = inverter.plant.startswith("LCL")
    i = flux = state(2) if lcl else i_g
    if inverter.plant == "LCL_saturated":  # its state is the flux over L_F
        i = flux / ca.sqrt(1 - ca.dot(flux, flux) / m["I_s"] ** 2)
    if inverter.outer == "power":
        error = ca.vertcat(r[0] - ca.dot(e, i_g), ca.dot(e, turned(i_g)) - r[1])
    else:
        v_dc = state(1)
        error = ca.vertcat(v_dc - 1, ca.norm_2(e) - r[1])
    i_ref = ca.vertcat(
        m["kP_1"] * error[0] + m["kI_1"] * first, m["kP_2"] * error[1] + m["kI_2"] * second
    )
    command = (
        m["kP_i"] * (i_ref - i)
        + m["kI_i"] * gamma
        + m["k_ff"] * e
        + omega / OMEGA_0 * m["L_d"] * turned(i)
    )
    rates = [deviation, locked, error[0], error[1], i_ref - i]

    to_grid = OMEGA_0 / m["L_g"] * (e - v - m["R_g"] * i_g) - omega * turned(i_g)
    from_converter = OMEGA_0 / m["L_F"] * (u_r - e - m["R_F"] * i) - omega * turned(flux)
    rates += [from_converter if inverter.plant == "LFilter" else to_grid]
    if lcl:
        rates += [from_converter]
    if inverter.outer != "power":
        rates += [(r[0] - ca.dot(u_r, i)) / (m["C_dc"] * v_dc)]
    if lcl:
        v_c, beside = state(2), ca.SX(2, 1)
        if inverter.plant == "LCL_RC":
            v_d = state(2)
            beside = (e - v_d) / m["R_d"]
        rates += [OMEGA_0 / m["C_F"] * (i - i_g - beside) - omega * turned(v_c)]
        if inverter.plant == "LCL_RC":
            rates += [OMEGA_0 / m["C_d"] * beside - omega * turned(v_d)]
        node_voltage = e - v_c - (m["R_C"] * (i - i_g) if inverter.plant == "LCL_R" else 0)
    elif inverter.plant == "LLFilter":
        node_voltage = (to_grid - from_converter) / OMEGA_0  # one current through both inductors
    else:
        node_voltage = e - v
    if inverter.shunt:
        v_s = state(2)
        i_DQ_shunt = (v_DQ - v_s) / m["R_s"]
        rates += [OMEGA_0 / m["C_s"] * i_DQ_shunt - OMEGA_0 * turned(v_s)]
    x, x_dot = ca.vertcat(*states), ca.vertcat(*rates)
    i_DQ = rotate.T @ i_g - i_DQ_shunt
    at = v if node == "pcc" else e
    rest = ca.vertcat(ca.dot(at, i_g) - point[0], ca.dot(at, turned(i_g)) - point[1])
    return x, z, r, v_DQ, point, x_dot, ca.vertcat(u_r - command, node_voltage), i_DQ, rest


def true_response(inverter: Inverter, point, node: str) -> np.ndarray:
    x, z, r, v_DQ, at, x_dot, zero, i_DQ, rest = nonlinear(inverter, node)
    whole, unknown = ca.vertcat(x_dot / OMEGA_0, zero, rest), ca.vertcat(x, z, r)
    residual = ca.Function("residual", [unknown, v_DQ, at], [whole])
    slope = ca.Function("slope", [unknown, v_DQ, at], [ca.densify(ca.jacobian(whole, unknown))])
    n = x.shape[0]
    start = np.zeros(n + 6)
    start[2], start[3] = point[0] / M["kI_1"], -point[1] / M["kI_2"]
    start[6:8], start[n : n + 4] = [point[0], -point[1]], [1.0, 0.0, 1.0, 0.0]
    start[n + 4 :] = [point[0], 1.0]
    if inverter.outer != "power":
        start[10 if inverter.plant.startswith("LCL") else 8] = 1.0
    given = [point[2], 0.0], list(point)
    found, _, _, message = fsolve(
        lambda one: np.array(residual(one, *given)).ravel(),
        start,
        fprime=lambda one: np.array(slope(one, *given)),
        full_output=True,
        xtol=1e-14,
    )
    assert np.abs(np.array(residual(found, *given))).max() < 1e-12, message
    assert abs(found[0]) < 1.0
    inner, outer = ca.vertcat(x_dot, zero), ca.vertcat(x, z)
    parts = [ca.jacobian(one, other) for one in (inner, i_DQ) for other in (outer, v_DQ)]
    linear = ca.Function("linear", [outer, r, v_DQ], [ca.densify(part) for part in parts])
    a, b, c, d = (
        np.array(part) for part in linear(found[: n + 4], found[n + 4 :], [point[2], 0.0])
    )
    mass = np.diag([1.0] * n + [0.0] * 4)
    return np.array([c @ np.linalg.solve(2j * np.pi * one * mass - a, b) + d for one in FREQUENCY])


INVERTERS = [
    *(
        Inverter(plant)
        for plant in ("LCL", "LFilter", "LCL_R", "LCL_RC", "LLFilter", "LCL_saturated")
    ),
    Inverter(shunt=True),
    Inverter("LFilter", shunt=True),
    Inverter(outer="voltage"),
    Inverter(outer="voltage", pll="v"),
    Inverter("LLFilter", outer="voltage"),
    Inverter("LCL_saturated", outer="voltage"),
    Inverter("LCL_RC", outer="voltage", pll="v", shunt=True),
]


@pytest.mark.slow
@each_of("node", ["capacitor", "pcc"])
@each_of("point", POINTS)
@each_of("inverter", INVERTERS, ids=str)
def test_a_diagram_of_extended_kinds_is_the_linearised_inverter(inverter, point, node):
    wanted = true_response(inverter, point, node)
    found = diagram_response(inverter, point, node)
    scale = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    assert (
        np.abs(found - wanted) <= 1e-8 * scale
    ).all()  # fsolve's tolerance through the equilibrium


# what the kinds become where their new parameter says nothing


def kind_response(name: str, s: complex, **given) -> np.ndarray:
    kind = find_kind(name, VOCABULARY)
    own = {one: M[one] for one in kind.parameters}
    rest = kind.context(
        OMEGA_0,
        (1.0, 0.0),
        {"i_ti": (0.9, 0.2), "u_r": (1.1, 0.2), "e": (1.02, 0.05), "i_g": (0.95, -0.1)},
    )
    a, b, c, d = (np.array(rows, dtype=float) for rows in kind.state_space(**(own | rest | given)))
    return c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d


@pytest.mark.parametrize(
    ("name", "given"),
    [("LCL_R", {"R_C": 0.0}), ("LCL_RC", {"R_d": 1e12}), ("LCL_saturated", {"I_s": 1e9})],
)
def test_an_lcl_without_what_it_has_more_is_an_lcl(name, given):
    for s in 2j * np.pi * FREQUENCY:
        assert kind_response(name, s, **given) == pytest.approx(
            kind_response("LCL", s), rel=1e-9, abs=1e-9
        )


def test_an_l_filter_behind_no_line_is_an_l_filter():
    for s in 2j * np.pi * FREQUENCY:
        found = kind_response("LLFilter", s, L_g=0.0, R_g=0.0)
        assert found == pytest.approx(kind_response("LFilter", s), rel=1e-12, abs=1e-12)


def test_a_damping_branch_that_is_all_there_is_stands_for_a_resistor_in_series():
    for s in 2j * np.pi * FREQUENCY:
        branch = kind_response("LCL_RC", s, C_F=1e-9, C_d=M["C_F"], R_d=M["R_C"])
        # 1e-4: what is left of the small capacitor at 10 kHz
        assert branch[:6] == pytest.approx(kind_response("LCL_R", s)[:6], rel=1e-4, abs=1e-4)


def test_a_shunt_is_minus_the_admittance_of_a_resistor_and_a_capacitor_in_series():
    j = np.array([[0.0, -1.0], [1.0, 0.0]])
    kind = find_kind("Shunt_RC", VOCABULARY)
    a, b, c, d = (np.array(rows) for rows in kind.state_space(R=0.07, C=0.11, omega_0=OMEGA_0))
    for s in 2j * np.pi * FREQUENCY:
        impedance = 0.07 * np.eye(2) + np.linalg.inv(0.11 * (s / OMEGA_0 * np.eye(2) + j))
        assert c @ np.linalg.solve(s * np.eye(2) - a, b) + d == pytest.approx(
            -np.linalg.inv(impedance), rel=1e-10
        )


# what has the plant's u_r at rest


def at_rest(text: str):
    diagram = parse_program(text)
    assert violations(diagram) == ()
    wiring = wire(diagram, VOCABULARY)
    table = parameter_table(wiring, "exact")
    values = {one.name: VALUES.get(one.name, one.typical) for one in table.free}
    parameters = {
        name: {key: values.get(str(table.of(name, key)), 0.0) for key in kind.parameters}
        for name, kind in wiring.kinds.items()
    }
    return equilibria(wiring, parameters, POINTS[0], "capacitor", OMEGA_0)[1]


def test_what_drives_the_command_has_the_plants_voltage_at_rest():
    found = at_rest(program(Inverter(outer="voltage")))
    plant = {port: np.array(z) for port, z in found["plant"].items()}
    j = np.array([[0.0, -1.0], [1.0, 0.0]])
    u_r = plant["e"] + (M["R_F"] * np.eye(2) + M["L_F"] * j) @ plant["i_ti"]
    assert found["dc_link"]["u"] == pytest.approx(u_r)
    assert found["dc_link"]["i"] == pytest.approx(plant["i_ti"])
    power = found["dc_link"]["u"] @ plant["i_ti"]  # P_in: what the inverter delivers and its losses
    assert power == pytest.approx(POINTS[0][0] + M["R_F"] * plant["i_ti"] @ plant["i_ti"])


def test_a_filter_of_the_command_rests_where_the_command_does():
    text = program(Inverter(outer="voltage")).replace('"dc_link.u")', '"measured.in_")')
    text += '\n    g.add("LPF1_dq", "measured")\n    g.connect("measured.out", "dc_link.u")'
    direct = at_rest(program(Inverter(outer="voltage")))["dc_link"]["u"]
    # the solver of the steady state ends within 1e-11 (test_equilibrium), here from another system
    # of equations
    assert at_rest(text)["dc_link"]["u"] == pytest.approx(direct, rel=1e-11)


def test_a_part_of_the_command_has_no_operating_point():
    text = program(Inverter(outer="voltage")).replace(
        '    g.connect("decoupling.out", "dc_link.u")\n', ""
    )
    (found,) = violations(parse_program(text))
    assert found.reason == "equilibrium"
    assert "dc_link.u, but that signal comes from behind the integrator of current" in found.message


def test_what_is_wired_like_a_command_that_follows_keeps_its_own_operating_point():
    # in the naive start u_r is a multiple of v_DQ; the magnitude of the same signal is that
    # multiple
    text = "\n".join(
        [
            "def build(g):",
            '    g.add("LFilter", "plant")',
            '    g.add("Magnitude", "magnitude")',
            '    g.add("Rot_i", "turn")',
            '    g.add("Gain", "angle", k=0.1)',
            '    g.add("ConstZero", "no_frequency")',
            '    g.connect("v_DQ", "plant.v_in")',
            '    g.connect("v_DQ", "plant.u_r")',
            '    g.connect("v_DQ", "magnitude.in_")',
            '    g.connect("no_frequency.out", "plant.delta_omega")',
            '    g.connect("plant.i_g", "turn.i_dq")',
            '    g.connect("magnitude.out", "angle.in_")',
            '    g.connect("angle.out", "turn.delta")',
            '    g.connect("turn.i_DQ", "i_DQ")',
        ]
    )
    assert at_rest(text)["magnitude"]["in_"] == pytest.approx((POINTS[0][2], 0.0))


# signs in a comparison


def through_negation(text: str, target: str, name: str) -> str:
    """The program with a Negate_dq in front of an input."""
    added = f'\n    g.add("Negate_dq", "{name}")\n    g.connect("{name}.out", "{target}")'
    return text.replace(f'"{target}")', f'"{name}.in_")') + added


def test_a_product_and_a_magnitude_keep_their_value_when_the_signs_cancel():
    text = program(Inverter(outer="voltage"))
    one = through_negation(text, "dc_link.u", "minus_u")
    both = through_negation(one, "dc_link.i", "minus_i_dc")
    magnitude = through_negation(text, "magnitude.in_", "minus_e")
    for other in (one, both, magnitude):
        assert violations(parse_program(other)) == ()
    assert compare(parse_program(text), parse_program(both)).same
    assert compare(parse_program(text), parse_program(magnitude)).same
    assert not compare(parse_program(text), parse_program(one)).same
