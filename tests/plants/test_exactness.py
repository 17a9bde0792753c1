"""With the exact equilibrium and true parameters a diagram is the linearisation of the nonlinear
inverter, to rounding.
"""

import casadi as ca
import numpy as np
import pytest
from collecting import each_of

from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.numeric import closed_loop
from ibrid.assembly.operating_point import plant_equilibrium
from ibrid.assembly.symbolic import symbolic_model
from ibrid.fit.kernel import admittance
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.modules import VOCABULARY
from ibrid.modules.vocabulary import find_kind
from ibrid.plants import PLANTS, benchmarks, random_stable, state_space
from ibrid.structure import parse_program, textbook, violations, wire
from ibrid.structure.reading.parameters import parameter_table, parameters_at

FREQUENCY = np.geomspace(0.5, 1e4, 25)
POINTS = [(1.0, 0.3, 1.0), (-0.6, 0.1, 1.04), (0.0, 0.0, 1.0), (0.5, -0.3, 0.95)]
RANDOM_PLANTS = 30


def response(diagram, values, point, omega_0: float, node: str, frequency=FREQUENCY) -> np.ndarray:
    """(K, 2, 2) by the kernel of the fit, for a diagram without delays."""
    model = symbolic_model(
        wire(diagram, VOCABULARY), equilibrium="exact", power_node=node, omega_0=omega_0
    )
    theta = [values[parameter.name] for parameter in model.parameters]
    return admittance(model, theta, point, 2 * np.pi * frequency)


def system(diagram, values, point, omega_0: float, node: str):
    wiring = wire(diagram, VOCABULARY)
    parameters = parameters_at(wiring, parameter_table(wiring, "exact"), values)
    matrices = module_matrices(
        wiring, parameters, point, equilibrium="exact", power_node=node, omega_0=omega_0
    )
    return closed_loop(wiring, matrices)


def assert_close(found: np.ndarray, wanted: np.ndarray, tolerance: float = 1e-8) -> None:
    """At each frequency relative to the largest entry there; an L filter without current has no
    admittance at all.
    """
    scale = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    assert (np.abs(found - wanted) <= tolerance * scale + 1e-12).all()


def assert_is_the_linearisation(plant, point) -> None:
    diagram = parse_program(plant.program)
    assert violations(diagram) == ()
    linear = state_space(plant, OperatingPoint("op", *point))
    given = (diagram, plant.diagram_values, point, plant.omega_0, plant.power_node)
    assert_close(response(*given), linear.admittance(FREQUENCY))
    by_control = system(*given)
    assert_close(
        np.moveaxis(by_control(2j * np.pi * FREQUENCY), -1, 0), linear.admittance(FREQUENCY)
    )
    # the same states up to their order and scale, so the same poles; 1e-6: a pair of close poles
    # moves by the root of rounding
    wanted, found = linear.poles, np.linalg.eigvals(by_control.A)
    assert len(found) == len(wanted)
    nearest = np.abs(found[:, None] - wanted[None, :]).min(axis=1)
    assert (nearest <= 1e-6 * np.abs(wanted).max()).all()


@pytest.mark.nightly
@each_of("point", POINTS)
@each_of("name", PLANTS)
def test_a_reference_inverters_diagram_is_its_linearisation(name, point):
    assert_is_the_linearisation(PLANTS[name], point)


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        {"decoupling": "nominal"},
        {"decoupling": "none"},
        {"feedforward": 0.7},
        {"feedforward": 0.0},
        {"omega_c_power": 300.0},
        {"L_decoupling": 0.11},
        {"f0_hz": 50.0},
    ],
    ids=str,
)
def test_the_benchmark_with_another_control_is_its_linearisation(overrides):
    plant = PLANTS["paper_like"].with_overrides(overrides)
    for point in POINTS:
        assert_is_the_linearisation(plant, point)


@pytest.mark.nightly
@each_of("number", range(RANDOM_PLANTS))
def test_a_random_inverters_diagram_is_its_linearisation(number):
    rng = np.random.default_rng([41, number])
    plant = random_stable(
        rng, population=("textbook", "wide")[number % 2], pll_filter=number % 3 == 0
    )
    for op in plant.operating_points:
        assert_is_the_linearisation(plant, (op.p, op.q, op.v))
    assert_is_the_linearisation(plant, (-0.4, 0.05, 1.02))


def test_the_textbook_diagram_is_the_shipped_benchmark():
    sweep = read_sweep(benchmarks()["paper_like"])
    plant = PLANTS["paper_like"]
    assert len(sweep.points) == 2
    for one in sweep.points:
        point = (one.op.p, one.op.q, one.op.v)
        found = response(
            textbook("gfl_pll_filter_exact"),
            plant.diagram_values,
            point,
            2 * np.pi * sweep.f0_hz,
            sweep.power_node,
            one.frequency,
        )
        assert_close(found, one.admittance)


OMEGA_0 = 2 * np.pi * 60
J = ca.DM([[0, -1], [1, 0]])
#: A grid-forming inverter: droop, voltage and current control, virtual impedance; per unit, 1/s and
#: rad/s.
FORMING = {
    "L_F": 0.12,
    "R_F": 0.01,
    "C_F": 0.07,
    "L_g": 0.18,
    "R_g": 0.02,
    "m": 3.0,
    "omega_p": 40.0,
    "n": 0.05,
    "kP_v": 0.4,
    "kI_v": 40.0,
    "kP_i": 0.6,
    "kI_i": 12.0,
    "R_v": 0.03,
    "X_v": 0.11,
}
PLANT_VALUES = {f"plant.{name}": FORMING[name] for name in ("L_F", "R_F", "C_F", "L_g", "R_g")}

DROOP = """
def build_gfm(g):
    g.add("LCL", "plant")
    g.add("Rot_v", "park_v")
    g.add("Rot_i", "park_i")
    g.add("PQ_calc", "power")
    g.add("LPF1", "p_filter", omega_c={omega_p})
    g.add("Gain", "droop", k=-{m})
    g.add("Integrator", "angle")
    g.add("Gain", "q_droop", k=-{n})
    g.add("ConstZero", "nothing")
    g.add("PackDQ", "reference")
    g.add("Gain_dq", "r_v", k=-{R_v})
    g.add("JMul_omega", "x_v", L={X_v})
    g.add("Negate_dq", "minus_x_v")
    g.connect("v_DQ", "park_v.v_DQ")
    g.connect("angle.out", "park_v.delta")
    g.connect("park_v.v_dq", "plant.v_in")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("angle.out", "park_i.delta")
    g.connect("park_i.i_DQ", "i_DQ")
    g.connect("plant.e", "power.e")
    g.connect("plant.i_g", "power.i")
    g.connect("power.p", "p_filter.in_")
    g.connect("p_filter.out", "droop.in_")
    g.connect("droop.out", "angle.in_")
    g.connect("droop.out", "plant.delta_omega")
    g.connect("power.q", "q_droop.in_")
    g.connect("q_droop.out", "reference.in_d")
    g.connect("nothing.out", "reference.in_q")
    g.connect("plant.i_g", "r_v.in_")
    g.connect("plant.i_g", "x_v.in_")
    g.connect("droop.out", "x_v.delta_omega")
    g.connect("x_v.out", "minus_x_v.in_")
"""
OPEN = """
    g.connect("reference.out", "plant.u_r")
    g.connect("r_v.out", "plant.u_r")
    g.connect("minus_x_v.out", "plant.u_r")
"""
CASCADE = """
    g.add("Negate_dq", "minus_e")
    g.add("PI_dq", "voltage", kP={kP_v}, kI={kI_v})
    g.add("Negate_dq", "minus_i")
    g.add("PI_dq", "current", kP={kP_i}, kI={kI_i})
    g.connect("plant.e", "minus_e.in_")
    g.connect("reference.out", "voltage.in_")
    g.connect("r_v.out", "voltage.in_")
    g.connect("minus_x_v.out", "voltage.in_")
    g.connect("minus_e.out", "voltage.in_")
    g.connect("plant.i_ti", "minus_i.in_")
    g.connect("voltage.out", "current.in_")
    g.connect("minus_i.out", "current.in_")
    g.connect("current.out", "plant.u_r")
    g.connect("plant.e", "plant.u_r")
"""


def forming_inverter(point, with_loops: bool) -> np.ndarray:
    """Admittance of the nonlinear grid-forming inverter, linearised at the operating point that its
    setpoints give.
    """
    m = FORMING
    rest = {
        port: np.array(z)
        for port, z in plant_equilibrium(
            find_kind("LCL", VOCABULARY), m, *point, "capacitor"
        ).items()
    }
    j = np.array([[0.0, -1.0], [1.0, 0.0]])
    z_v = m["R_v"] * np.eye(2) + m["X_v"] * j
    # on the d axis lies what the reference is compared with
    aligned = (rest["e"] if with_loops else rest["u_r"]) + z_v @ rest["i_g"]
    delta_eq = np.arctan2(aligned[1], aligned[0])
    turn = np.array([[np.cos(delta_eq), np.sin(delta_eq)], [-np.sin(delta_eq), np.cos(delta_eq)]])
    i_ti_eq, e_eq, i_g_eq, u_eq = (turn @ rest[port] for port in ("i_ti", "e", "i_g", "u_r"))

    x = ca.SX.sym("x", 8 + 4 * with_loops)  # type: ignore[arg-type]
    v_DQ = ca.SX.sym("v_DQ", 2)  # type: ignore[arg-type]
    i_ti, e, i_g, delta, p_filtered = x[0:2], x[2:4], x[4:6], x[6], x[7]
    rotate = ca.vertcat(
        ca.horzcat(ca.cos(delta), ca.sin(delta)), ca.horzcat(-ca.sin(delta), ca.cos(delta))
    )
    v = rotate @ v_DQ
    p, q = ca.dot(e, i_g), ca.dot(e, J @ i_g)
    deviation = -m["m"] * (p_filtered - point[0])
    omega = OMEGA_0 + deviation
    reference = ca.vertcat(float(np.hypot(*aligned)) - m["n"] * (q - point[1]), 0)
    error = reference - m["R_v"] * i_g - omega / OMEGA_0 * m["X_v"] * (J @ i_g)
    states = np.concatenate([i_ti_eq, e_eq, i_g_eq, [delta_eq, point[0]]])
    rates = []
    if with_loops:
        voltage, current = x[8:10], x[10:12]
        i_ref = m["kP_v"] * (error - e) + m["kI_v"] * voltage
        u_r = m["kP_i"] * (i_ref - i_ti) + m["kI_i"] * current + e
        rates = [error - e, i_ref - i_ti]
        states = np.concatenate([states, i_ti_eq / m["kI_v"], (u_eq - e_eq) / m["kI_i"]])
    else:
        u_r = error
    x_dot = ca.vertcat(
        OMEGA_0 / m["L_F"] * (u_r - e - m["R_F"] * i_ti) - omega * (J @ i_ti),
        OMEGA_0 / m["C_F"] * (i_ti - i_g) - omega * (J @ e),
        OMEGA_0 / m["L_g"] * (e - v - m["R_g"] * i_g) - omega * (J @ i_g),
        deviation,
        m["omega_p"] * (p - p_filtered),
        *rates,
    )
    i_DQ = rotate.T @ i_g
    f = ca.Function("f", [x, v_DQ], [x_dot])
    assert (
        np.abs(np.array(f(states, [point[2], 0.0]))).max() < 1e-9
    )  # it is at rest: the operating point is right
    parts = [
        ca.jacobian(x_dot, x),
        ca.jacobian(x_dot, v_DQ),
        ca.jacobian(i_DQ, x),
        ca.jacobian(i_DQ, v_DQ),
    ]
    matrices = ca.Function("linear", [x, v_DQ], [ca.densify(part) for part in parts])(
        states, [point[2], 0.0]
    )
    a, b, c, d = (np.array(part) for part in matrices)
    return np.array(
        [c @ np.linalg.solve(2j * np.pi * one * np.eye(len(a)) - a, b) + d for one in FREQUENCY]
    )


@pytest.mark.slow
@each_of("point", POINTS)
@each_of("with_loops", [True, False], ids=["cascade", "open loop"])
def test_a_grid_forming_inverters_diagram_is_its_linearisation(with_loops, point):
    diagram = parse_program((DROOP + (CASCADE if with_loops else OPEN)).format(**FORMING))
    assert violations(diagram) == ()
    found = response(diagram, PLANT_VALUES, point, OMEGA_0, "capacitor")
    assert_close(found, forming_inverter(point, with_loops))
