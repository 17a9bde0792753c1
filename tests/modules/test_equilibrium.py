"""The operating point: of the plant, of the controller frame, and of every signal that follows from
them.
"""

from dataclasses import replace
from math import atan2, cos, sin

import casadi as ca
import numpy as np
import pytest
from collecting import each_of
from random_diagrams import random_legal_diagram
from scipy.optimize import fsolve

from ibrid.assembly.equilibrium import equilibria
from ibrid.assembly.known_at_rest import carried
from ibrid.assembly.operating_point import plant_equilibrium
from ibrid.assembly.signals_at_rest import to_frame
from ibrid.errors import DiagramError, OperatingPointError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.modules import VOCABULARY
from ibrid.modules.behaviour import Element
from ibrid.modules.vocabulary import find_kind
from ibrid.plants import PLANTS, GFLParameters
from ibrid.structure import parse_program, textbook, violations, wire
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.steady_state import steady_order, unknown_equilibria

OMEGA_0 = 2 * np.pi * 60
J = np.array([[0.0, -1.0], [1.0, 0.0]])
#: Some ten operations with numbers of order one, each rounded by 1.1e-16, in the order of whichever
#: processor.
ROUNDING = 1e-14
LCL = {"L_F": 0.15, "R_F": 0.02, "C_F": 0.066, "L_g": 0.15, "R_g": 0.03}
POINTS = [
    (p, q, v)
    for p in (-1.2, -0.7, 0.0, 0.4, 1.2)
    for q in (-0.6, 0.0, 0.5)
    for v in (0.9, 1.0, 1.1)
]
POINT = (0.8, 0.25, 1.03)


def impedance(resistance: float, reactance: float) -> np.ndarray:
    return resistance * np.eye(2) + reactance * J


def solved(p: float, q: float, v: float, node: str, parameters=LCL) -> dict[str, np.ndarray]:
    """The nonlinear equations at rest by a general solver, begun at no load."""
    series, terminal = impedance(parameters["R_g"], parameters["L_g"]), np.array([v, 0.0])

    def residual(x: np.ndarray, part: float) -> np.ndarray:
        e, i_g = x[:2], x[2:]
        at = e if node == "capacitor" else terminal
        return np.concatenate(
            [e - terminal - series @ i_g, [at @ i_g - part * p, at @ J @ i_g - part * q]]
        )

    x = np.array([v, 0.0, 0.0, 0.0])
    for part in (
        0.25,
        0.5,
        0.75,
        1.0,
    ):  # p and q are raised in steps, so that the solution stays on the upper branch
        x = fsolve(residual, x, (part,), xtol=1e-14, full_output=True)[0]
        assert np.abs(residual(x, part)).max() < 1e-12
    e, i_g = x[:2], x[2:]
    i_ti = i_g + parameters["C_F"] * J @ e
    u_r = e + impedance(parameters["R_F"], parameters["L_F"]) @ i_ti
    return {"v_in": terminal, "e": e, "i_g": i_g, "i_ti": i_ti, "i_C": i_ti - i_g, "u_r": u_r}


@each_of("node", ["capacitor", "pcc"])
@each_of(("p", "q", "v"), POINTS)
def test_the_plant_is_at_rest_where_a_solver_finds_it(p, q, v, node):
    found = plant_equilibrium(find_kind("LCL", VOCABULARY), LCL, p, q, v, node)
    wanted = solved(p, q, v, node)
    assert found.keys() == wanted.keys()
    for port, z in wanted.items():
        assert np.array(found[port]) == pytest.approx(z, abs=1e-11), port  # the solver's tolerance


@each_of("node", ["capacitor", "pcc"])
@each_of(("p", "q", "v"), POINTS)
def test_an_l_filter_is_at_rest_with_its_power_at_the_terminals(p, q, v, node):
    found = {
        port: np.array(z)
        for port, z in plant_equilibrium(
            find_kind("LFilter", VOCABULARY), LCL, p, q, v, node
        ).items()
    }
    terminal = np.array([v, 0.0])
    assert found["e"] == pytest.approx(terminal)
    assert terminal @ found["i_g"] == pytest.approx(p, abs=ROUNDING)
    assert terminal @ J @ found["i_g"] == pytest.approx(q, abs=ROUNDING)
    assert (found["i_ti"] == found["i_g"]).all()
    assert found["u_r"] == pytest.approx(
        terminal + impedance(LCL["R_F"], LCL["L_F"]) @ found["i_g"]
    )


#: Behind an LCL filter, with the frame on the capacitor voltage because a PLL locks to it.
LOCKED = [
    name
    for name, plant in PLANTS.items()
    if isinstance(plant.parameters, GFLParameters) and plant.parameters.filter == "LCL"
]


@each_of("name", LOCKED)
@each_of(("p", "q", "v"), [(1.0, 0.3, 1.0), (-0.8, 0.1, 0.95), (0.0, 0.0, 1.05)])
def test_the_reference_inverters_rest_where_the_plant_and_the_frame_say(name, p, q, v):
    plant = PLANTS[name]
    state = dict(
        zip(plant.dynamics.states, plant.equilibrium(OperatingPoint("op", p, q, v)), strict=True)
    )
    values = {
        key.removeprefix("plant."): value
        for key, value in plant.diagram_values.items()
        if "plant." in key
    }
    found = plant_equilibrium(find_kind("LCL", VOCABULARY), values, p, q, v, "capacitor")
    e = found["e"]
    size = (e[0] ** 2 + e[1] ** 2) ** 0.5
    assert atan2(e[1], e[0]) == pytest.approx(state["pll.angle"], abs=1e-12)
    for port in ("i_ti", "e", "i_g"):
        in_frame = to_frame((e[0] / size, e[1] / size), found[port])
        assert in_frame == pytest.approx(
            (state[f"plant.{port}_d"], state[f"plant.{port}_q"]), abs=1e-11
        )


def test_more_power_than_the_line_carries_is_not_a_number():
    found = plant_equilibrium(
        find_kind("LCL", VOCABULARY), {**LCL, "L_g": 0.9}, 1.0, 0.0, 1.0, "capacitor"
    )
    assert np.isnan([*found["e"], *found["i_g"], *found["i_ti"], *found["u_r"]]).all()
    limit = plant_equilibrium(
        find_kind("LCL", VOCABULARY), {**LCL, "R_g": 0.0, "L_g": 0.5}, 1.0, 0.0, 1.0, "capacitor"
    )
    assert np.hypot(*limit["e"]) == pytest.approx(
        0.5**0.5
    )  # p = v^2/(2 x): the last point that exists
    with pytest.raises(OperatingPointError):
        PLANTS["paper_like"].with_overrides({"L_g": 0.9}).equilibrium(
            OperatingPoint("op", 1.0, 0.0, 1.0)
        )


def test_the_operating_point_of_another_plant_is_not_guessed():
    with pytest.raises(
        DiagramError, match=r"known for LCL, LFilter, .* or LCL_saturated, found Motor"
    ):
        plant_equilibrium(
            replace(find_kind("LCL", VOCABULARY), name="Motor", branches=None),
            {},
            1.0,
            0.0,
            1.0,
            "pcc",
        )


def program(text: str):
    lines = [line.strip() for line in text.strip().splitlines() if line.strip()]
    return parse_program("def build(g):\n" + "\n".join(f"    {line}" for line in lines))


def at_rest(text: str, point=POINT, node: str = "capacitor", plant=LCL):
    """Frame and equilibria of a program, by numbers; the same by symbols is asserted on the way."""
    diagram = program(text)
    assert violations(diagram) == (), violations(diagram)
    wiring = wire(diagram, VOCABULARY)
    table = parameter_table(wiring, "exact")
    values = {one.name: one.typical for one in table.free} | {
        f"plant.{name}": value for name, value in plant.items()
    }

    def parameters(take):
        return {
            name: {key: take(table.of(name, key)) for key in kind.parameters}
            for name, kind in wiring.kinds.items()
        }

    numbers = parameters(lambda bound: values[bound] if isinstance(bound, str) else bound)
    frame, found = equilibria(wiring, numbers, point, node, OMEGA_0)
    theta, place = ca.SX.sym("theta", len(table.free)), ca.SX.sym("point", 3)  # type: ignore[arg-type]
    names = list(table.names)
    symbols = parameters(
        lambda bound: theta[names.index(bound)] if isinstance(bound, str) else bound
    )
    turned, same = equilibria(wiring, symbols, (place[0], place[1], place[2]), node, OMEGA_0)
    flat = [*turned, *(part for ports in same.values() for pair in ports.values() for part in pair)]
    plain = [
        *frame,
        *(part for ports in found.values() for pair in ports.values() for part in pair),
    ]
    function = ca.Function("rest", [theta, place], [ca.vertcat(*[ca.SX(one) for one in flat])])
    symbolic = np.array(function([values[name] for name in names], list(point))).ravel()
    assert symbolic == pytest.approx(plain, rel=1e-12, abs=1e-12, nan_ok=True)
    return frame, found


def angle(z) -> float:
    return atan2(z[1], z[0])


def angle_of(text: str, point=POINT, **given) -> float:
    frame, _ = at_rest(text, point, **given)
    assert np.hypot(*frame) == pytest.approx(1.0, abs=ROUNDING)
    return angle(frame)


def grid(port: str, point=POINT, node: str = "capacitor", plant=LCL) -> np.ndarray:
    return np.array(plant_equilibrium(find_kind("LCL", VOCABULARY), plant, *point, node)[port])


#: Plant, rotations, and i_g out; the PLL, the loops and u_r are what a test adds.
FRAMED = """
    g.add("LCL", "plant")
    g.add("Rot_v", "park_v")
    g.add("Rot_i", "park_i")
    g.connect("v_DQ", "park_v.v_DQ")
    g.connect("park_v.v_dq", "plant.v_in")
    g.connect("plant.i_g", "park_i.i_dq")
    g.connect("park_i.i_DQ", "i_DQ")
"""
LOCKED = (
    FRAMED
    + """
    g.add("SRF_PLL", "pll")
    g.connect("pll.delta", "park_v.delta")
    g.connect("pll.delta", "park_i.delta")
    g.connect("pll.delta_omega", "plant.delta_omega")
    g.connect("plant.e", "plant.u_r")
"""
)
#: A power-frequency droop turns the frame.
DROOP = (
    FRAMED
    + """
    g.add("PQ_calc", "power")
    g.add("LPF1", "p_filter")
    g.add("Gain", "droop", k=-3.0)
    g.add("Integrator", "angle")
    g.connect("plant.e", "power.e")
    g.connect("plant.i_g", "power.i")
    g.connect("power.p", "p_filter.in_")
    g.connect("p_filter.out", "droop.in_")
    g.connect("droop.out", "angle.in_")
    g.connect("droop.out", "plant.delta_omega")
    g.connect("angle.out", "park_v.delta")
    g.connect("angle.out", "park_i.delta")
"""
)
#: The reference of the voltage, with a reactive droop, on the d axis.
REFERENCE = """
    g.add("Gain", "q_droop", k=-0.05)
    g.add("ConstZero", "nothing")
    g.add("PackDQ", "reference")
    g.connect("power.q", "q_droop.in_")
    g.connect("q_droop.out", "reference.in_d")
    g.connect("nothing.out", "reference.in_q")
"""
#: Voltage control on the capacitor voltage and current control below it.
VOLTAGE_LOOP = (
    REFERENCE
    + """
    g.add("Negate_dq", "minus_e")
    g.add("PI_dq", "voltage")
    g.add("Negate_dq", "minus_i")
    g.add("PI_dq", "current")
    g.connect("plant.e", "minus_e.in_")
    g.connect("reference.out", "voltage.in_")
    g.connect("minus_e.out", "voltage.in_")
    g.connect("plant.i_ti", "minus_i.in_")
    g.connect("voltage.out", "current.in_")
    g.connect("minus_i.out", "current.in_")
    g.connect("current.out", "plant.u_r")
    g.connect("plant.e", "plant.u_r")
"""
)
R_V, X_V = 0.04, 0.17
#: (R_v + X_v J) i_g taken off a command or a reference: drives `TARGET`.
VIRTUAL = f"""
    g.add("Gain_dq", "r_v", k={-R_V})
    g.add("JMul", "x_v", L={X_V / OMEGA_0})
    g.add("Negate_dq", "minus_x_v")
    g.connect("plant.i_g", "r_v.in_")
    g.connect("plant.i_g", "x_v.in_")
    g.connect("x_v.out", "minus_x_v.in_")
    g.connect("r_v.out", "TARGET")
    g.connect("minus_x_v.out", "TARGET")
"""


@pytest.mark.slow
@each_of("point", POINTS)
@each_of("node", ["capacitor", "pcc"])
def test_a_pll_on_the_capacitor_voltage_puts_it_on_the_d_axis(point, node):
    text = LOCKED + 'g.connect("plant.e_q", "pll.e_q")'
    assert angle_of(text, point, node=node) == pytest.approx(
        angle(grid("e", point, node)), abs=ROUNDING
    )


def test_a_pll_on_the_terminal_voltage_leaves_the_frame_in_the_grids():
    text = (
        LOCKED
        + """
        g.add("SliceQ", "v_q")
        g.connect("park_v.v_dq", "v_q.in_")
        g.connect("v_q.out", "pll.e_q")
    """
    )
    assert angle_of(text) == pytest.approx(0.0, abs=ROUNDING)


def test_a_pll_on_a_voltage_filtered_before_its_rotation_leaves_the_grids_frame():
    text = (
        LOCKED
        + """
        g.add("LPF1_dq", "slow")
        g.add("Rot_v", "park_slow")
        g.add("SliceQ", "v_q")
        g.connect("v_DQ", "slow.in_")
        g.connect("slow.out", "park_slow.v_DQ")
        g.connect("pll.delta", "park_slow.delta")
        g.connect("park_slow.v_dq", "v_q.in_")
        g.connect("v_q.out", "pll.e_q")
    """
    )
    frame, found = at_rest(text)
    assert angle(frame) == pytest.approx(0.0, abs=ROUNDING)
    assert found["park_slow"]["v_DQ"] == pytest.approx((POINT[2], 0.0))


@pytest.mark.parametrize(
    "chain",
    [
        ("LPF1",),
        ("Notch", "LPF1"),
        ("Gain",),
        ("Negate",),
        ("Negate", "Pade1", "Gain", "LPF1"),
    ],
)
def test_a_filter_a_gain_or_a_sign_before_the_pll_does_not_turn_the_frame(chain):
    ends = ["plant.e_q", *(f"block{k}.out" for k in range(len(chain)))]
    lines = [
        f'g.add("{kind}", "block{k}")\ng.connect("{ends[k]}", "block{k}.in_")'
        for k, kind in enumerate(chain)
    ]
    text = LOCKED + "\n".join(lines) + f'\ng.connect("{ends[-1]}", "pll.e_q")'
    assert angle_of(text) == pytest.approx(angle(grid("e")), abs=ROUNDING)


def test_a_pll_on_a_compensated_voltage_puts_that_on_the_d_axis():
    text = (
        LOCKED
        + VIRTUAL.replace("TARGET", "point.in_")
        + """
        g.add("Gain_dq", "point", k=1.0)
        g.add("SliceQ", "v_q")
        g.connect("plant.e", "point.in_")
        g.connect("point.out", "v_q.in_")
        g.connect("v_q.out", "pll.e_q")
    """
    )
    wanted = grid("e") - impedance(R_V, X_V) @ grid("i_g")
    assert angle_of(text) == pytest.approx(angle(wanted), abs=ROUNDING)


def test_a_pll_on_axes_that_were_taken_apart_and_packed_again_is_followed():
    text = (
        LOCKED
        + """
        g.add("SliceD", "d")
        g.add("SliceQ", "q")
        g.add("LPF1", "d_filter")
        g.add("LPF1", "q_filter")
        g.add("PackDQ", "again")
        g.add("SliceQ", "v_q")
        g.connect("park_v.v_dq", "d.in_")
        g.connect("park_v.v_dq", "q.in_")
        g.connect("d.out", "d_filter.in_")
        g.connect("q.out", "q_filter.in_")
        g.connect("d_filter.out", "again.in_d")
        g.connect("q_filter.out", "again.in_q")
        g.connect("again.out", "v_q.in_")
        g.connect("v_q.out", "pll.e_q")
    """
    )
    assert angle_of(text) == pytest.approx(0.0, abs=ROUNDING)


@pytest.mark.parametrize("between", ["", 'g.add("Gain", "between", k=0.4)'])
def test_a_pll_that_is_drawn_as_pi_and_integrator_is_one(between):
    text = (
        LOCKED.replace('g.add("SRF_PLL", "pll")', "")
        .replace("pll.delta_omega", "pi.out")
        .replace("pll", "angle")
    )
    text = (
        text.replace("angle.delta", "angle.out")
        + between
        + """
        g.add("PI", "pi", kP=60, kI=1400)
        g.add("Integrator", "angle")
        g.connect("plant.e_q", "pi.in_")
    """
    )
    if between:
        text += 'g.connect("pi.out", "between.in_")\ng.connect("between.out", "angle.in_")'
    else:
        text += 'g.connect("pi.out", "angle.in_")'
    assert angle_of(text) == pytest.approx(angle(grid("e")), abs=ROUNDING)


def test_a_pll_whose_frequency_is_integrated_outside_is_one():
    text = (
        LOCKED.replace('pll.delta"', 'angle.out"')
        + """
        g.add("Integrator", "angle")
        g.connect("pll.delta_omega", "angle.in_")
        g.connect("plant.e_q", "pll.e_q")
    """
    )
    assert angle_of(text) == pytest.approx(angle(grid("e")), abs=ROUNDING)


def test_a_pll_beside_other_signals_at_the_angle_still_decides():
    text = (
        LOCKED
        + """
        g.add("Gain", "damping", k=0.01)
        g.connect("plant.e_q", "pll.e_q")
        g.connect("plant.e_q", "damping.in_")
        g.connect("damping.out", "park_v.delta")
        g.connect("damping.out", "park_i.delta")
    """
    )
    assert angle_of(text) == pytest.approx(angle(grid("e")), abs=ROUNDING)


def test_what_does_not_turn_with_the_frame_shifts_the_angle_at_which_the_pll_rests():
    text = (
        LOCKED
        + """
        g.add("SliceD", "v_D")
        g.add("Gain", "bias", k=0.1)
        g.connect("v_DQ", "v_D.in_")
        g.connect("v_D.out", "bias.in_")
        g.connect("bias.out", "pll.e_q")
        g.connect("plant.e_q", "pll.e_q")
    """
    )
    frame, _ = at_rest(text)
    assert 0.1 * POINT[2] + to_frame(frame, grid("e"))[1] == pytest.approx(0.0, abs=ROUNDING)
    assert to_frame(frame, grid("e"))[0] > 0.9


@pytest.mark.parametrize("source", ["zero.out", "integral.out"])
def test_a_pll_whose_input_says_nothing_leaves_the_capacitor_voltage_on_d(source):
    text = (
        LOCKED
        + f"""
        g.add("ConstZero", "zero")
        g.add("Integrator", "integral")
        g.connect("plant.e_q", "integral.in_")
        g.connect("{source}", "pll.e_q")
    """
    )
    assert angle_of(text) == pytest.approx(angle(grid("e")), abs=ROUNDING)


def test_a_voltage_loop_puts_the_capacitor_voltage_on_d():
    assert angle_of(DROOP + VOLTAGE_LOOP) == pytest.approx(angle(grid("e")), abs=ROUNDING)


def test_a_voltage_loop_with_a_constant_reference_puts_the_capacitor_voltage_on_d():
    text = DROOP + VOLTAGE_LOOP.replace('g.connect("reference.out", "voltage.in_")', "")
    assert angle_of(text) == pytest.approx(angle(grid("e")), abs=ROUNDING)


@pytest.mark.parametrize("filtered", [False, True])
def test_a_voltage_loop_behind_a_virtual_impedance_puts_the_inner_voltage_on_d(filtered):
    text = DROOP + VOLTAGE_LOOP + VIRTUAL.replace("TARGET", "voltage.in_")
    if filtered:
        text = text.replace('"plant.i_g", "r_v.in_"', '"slow.out", "r_v.in_"')
        text = text.replace('"plant.i_g", "x_v.in_"', '"slow.out", "x_v.in_"')
        text += 'g.add("LPF1_dq", "slow")\ng.connect("plant.i_g", "slow.in_")'
    wanted = grid("e") + impedance(R_V, X_V) @ grid("i_g")
    assert angle_of(text) == pytest.approx(angle(wanted), abs=ROUNDING)


def test_a_voltage_loop_whose_reference_is_filtered_puts_the_capacitor_voltage_on_d():
    text = (
        DROOP
        + VOLTAGE_LOOP.replace('"reference.out", "voltage.in_"', '"slow.out", "voltage.in_"')
        + """
        g.add("LPF1_dq", "slow")
        g.connect("reference.out", "slow.in_")
    """
    )
    assert angle_of(text) == pytest.approx(angle(grid("e")), abs=ROUNDING)


def test_a_virtual_impedance_that_is_packed_with_the_reference_is_seen():
    """The reference is [V* - n q + x i_q, -x i_d]: its q axis is known, its d axis is not."""
    text = (
        DROOP
        + VOLTAGE_LOOP.replace('g.connect("nothing.out", "reference.in_q")', "")
        + f"""
        g.add("SliceD", "i_d")
        g.add("SliceQ", "i_q")
        g.add("Gain", "x_on_q", k={-X_V})
        g.add("Gain", "x_on_d", k={X_V})
        g.connect("plant.i_g", "i_d.in_")
        g.connect("plant.i_g", "i_q.in_")
        g.connect("i_d.out", "x_on_q.in_")
        g.connect("i_q.out", "x_on_d.in_")
        g.connect("x_on_d.out", "reference.in_d")
        g.connect("x_on_q.out", "reference.in_q")
    """
    )
    wanted = grid("e") + impedance(0.0, X_V) @ grid("i_g")
    assert angle_of(text) == pytest.approx(angle(wanted), abs=ROUNDING)


def test_without_a_voltage_loop_the_converter_voltage_is_on_d():
    text = DROOP + REFERENCE + 'g.connect("reference.out", "plant.u_r")'
    assert angle_of(text) == pytest.approx(angle(grid("u_r")), abs=ROUNDING)


def test_without_a_voltage_loop_what_is_taken_off_the_command_is_added_to_the_voltage_on_d():
    text = (
        DROOP
        + REFERENCE
        + VIRTUAL.replace("TARGET", "plant.u_r")
        + 'g.connect("reference.out", "plant.u_r")'
    )
    wanted = grid("u_r") + impedance(R_V, X_V) @ grid("i_g")
    assert angle_of(text) == pytest.approx(angle(wanted), abs=ROUNDING)


def test_a_delayed_command_is_on_d_too():
    text = (
        DROOP
        + REFERENCE
        + """
        g.add("Delay", "late")
        g.connect("reference.out", "late.in_")
        g.connect("late.out", "plant.u_r")
    """
    )
    assert angle_of(text) == pytest.approx(angle(grid("u_r")), abs=ROUNDING)


def test_where_nothing_decides_the_capacitor_voltage_is_on_d():
    current_alone = (
        DROOP
        + """
        g.add("PI_dq", "current")
        g.add("PackDQ", "reference")
        g.add("PI", "q_loop")
        g.connect("power.q", "q_loop.in_")
        g.connect("q_loop.out", "reference.in_d")
        g.connect("q_loop.out", "reference.in_q")
        g.connect("reference.out", "current.in_")
        g.connect("plant.i_ti", "current.in_")
        g.connect("current.out", "plant.u_r")
    """
    )
    assert angle_of(current_alone) == pytest.approx(angle(grid("e")), abs=ROUNDING)
    # the same with a constant reference: a current loop is no voltage loop
    assert angle_of(
        current_alone.replace('g.connect("reference.out", "current.in_")', "")
    ) == pytest.approx(angle(grid("e")), abs=ROUNDING)
    fixed = (
        FRAMED
        + """
        g.add("ConstZero", "zero")
        g.connect("zero.out", "park_v.delta")
        g.connect("zero.out", "park_i.delta")
        g.connect("zero.out", "plant.delta_omega")
        g.connect("plant.e", "plant.u_r")
    """
    )
    assert angle_of(fixed) == pytest.approx(angle(grid("e")), abs=ROUNDING)


def test_without_rotations_the_controller_works_in_the_grid_frame():
    frame, found = at_rest(
        """
        g.add("LCL", "plant")
        g.add("ConstZero", "zero")
        g.connect("zero.out", "plant.delta_omega")
        g.connect("v_DQ", "plant.v_in")
        g.connect("plant.e", "plant.u_r")
        g.connect("plant.i_g", "i_DQ")
        """
    )
    assert frame == (1.0, 0.0)
    assert found["plant"]["e"] == pytest.approx(tuple(grid("e")))
    assert found["plant"]["e"][1] > 0.1


@pytest.mark.parametrize("point", [(-1.2, 0.3, 1.0), (0.0, 0.0, 1.0), (1.2, -0.4, 1.1)])
def test_the_plants_equilibrium_is_turned_into_the_frame(point):
    frame, found = at_rest(LOCKED + 'g.connect("plant.e_q", "pll.e_q")', point)
    turn = np.array([[frame[0], frame[1]], [-frame[1], frame[0]]])
    for port in ("i_ti", "e", "i_g"):
        assert found["plant"][port] == pytest.approx(turn @ grid(port, point), abs=ROUNDING)
    assert found["plant"]["e"][1] == pytest.approx(0.0, abs=ROUNDING)
    assert found["park_v"]["v_DQ"] == (point[2], 0.0)
    assert found["park_i"]["i_dq"] == found["plant"]["i_g"]


def test_the_operating_point_is_carried_through_sums_filters_delays_and_memoryless_modules():
    text = (
        LOCKED
        + """
        g.connect("plant.e_q", "pll.e_q")
        g.add("LPF1_dq", "slow")
        g.add("Delay", "late")
        g.add("JMul", "cross", L=0.0004)
        g.add("Gain_dq", "half", k=0.5)
        g.add("Negate_dq", "minus")
        g.add("SliceD", "d")
        g.add("SliceQ", "q")
        g.add("Notch", "notch")
        g.add("Pade1", "pade")
        g.add("PackDQ", "swapped")
        g.add("Pade1_dq", "pade_dq")
        g.add("JMul_omega", "turning", L=0.2)
        g.add("PQ_calc", "power")
        g.add("JMul_omega", "last", L=0.1)
        g.connect("plant.i_ti", "slow.in_")
        g.connect("plant.i_C", "slow.in_")
        g.connect("slow.out", "late.in_")
        g.connect("late.out", "cross.in_")
        g.connect("plant.e", "half.in_")
        g.connect("cross.out", "minus.in_")
        g.connect("half.out", "minus.in_")
        g.connect("park_v.v_dq", "minus.in_")
        g.connect("minus.out", "d.in_")
        g.connect("plant.i_g", "q.in_")
        g.connect("d.out", "notch.in_")
        g.connect("q.out", "pade.in_")
        g.connect("plant.e_q", "pade.in_")
        g.connect("notch.out", "swapped.in_q")
        g.connect("pade.out", "swapped.in_d")
        g.connect("plant.i_g", "turning.in_")
        g.connect("pll.delta_omega", "turning.delta_omega")
        g.connect("turning.out", "pade_dq.in_")
        g.connect("swapped.out", "power.e")
        g.connect("pade_dq.out", "power.i")
        g.connect("swapped.out", "last.in_")
        g.connect("v_DQ", "last.in_")
        g.connect("power.p", "last.delta_omega")
    """
    )
    frame, found = at_rest(text)
    turn = np.array([[frame[0], frame[1]], [-frame[1], frame[0]]])
    e, i_g, i_ti, i_c = (turn @ grid(port) for port in ("e", "i_g", "i_ti", "i_C"))
    v_dq = turn @ [POINT[2], 0.0]
    minus = -(OMEGA_0 * 0.0004 * (J @ (i_ti + i_c)) + 0.5 * e + v_dq)
    swapped = np.array([i_g[1] + e[1], minus[0]])
    assert found["power"]["e"] == pytest.approx(tuple(swapped), abs=ROUNDING)
    assert found["power"]["i"] == pytest.approx(tuple(0.2 * J @ i_g), abs=ROUNDING)
    assert found["last"]["in_"] == pytest.approx((swapped[0] + POINT[2], swapped[1]), abs=ROUNDING)
    assert found["turning"]["in_"] == pytest.approx(tuple(i_g), abs=ROUNDING)


@pytest.mark.parametrize(
    ("lost", "needed"),
    [
        ('g.add("PI_dq", "lost")\ng.connect("plant.e", "lost.in_")', "lost.out"),
        (
            'g.add("Integrator", "x")\ng.add("PackDQ", "lost")\ng.connect("plant.e_q", "x.in_")\n'
            'g.connect("x.out", "lost.in_d")\ng.connect("plant.e_q", "lost.in_q")',
            "lost.out",
        ),
        ('g.add("Gain_dq", "lost")\ng.connect("lost.out", "lost.in_")', "lost.out"),
    ],
)
def test_an_operating_point_behind_an_integrator_or_a_loop_is_one_sentence(lost, needed):
    text = (
        LOCKED
        + 'g.connect("plant.e_q", "pll.e_q")\n'
        + lost
        + f"""
        g.add("JMul_omega", "asks")
        g.connect("{needed}", "asks.in_")
        g.connect("plant.i_g", "asks.in_")
        g.connect("pll.delta_omega", "asks.delta_omega")
    """
    )
    wiring = wire(program(text), VOCABULARY)
    table = parameter_table(wiring, "exact")
    parameters = {name: dict.fromkeys(kind.parameters, 0.1) for name, kind in wiring.kinds.items()}
    assert table.free
    with pytest.raises(
        DiagramError,
        match=r"asks \(JMul_omega\) needs the operating point at asks.in_, which does not",
    ):
        equilibria(wiring, parameters, POINT, "capacitor", OMEGA_0)
    assert unknown_equilibria(wiring) == (("asks", "in_"),)


def test_an_operating_point_that_does_not_exist_is_not_a_number_anywhere():
    plant = {**LCL, "L_g": 0.9}
    frame, found = at_rest(
        LOCKED + 'g.connect("plant.e_q", "pll.e_q")', (1.0, 0.0, 1.0), plant=plant
    )
    assert np.isnan(frame).all()
    assert np.isnan(found["plant"]["i_ti"]).all()
    frame, _ = at_rest(DROOP + VOLTAGE_LOOP, (1.0, 0.0, 1.0), plant=plant)
    assert np.isnan(frame).all()


def test_the_frame_of_the_textbook_diagrams_follows_their_pll():
    for name, target in (("gfl", "pll.e_q"), ("gfl_pll_filter_exact", "pll.e_q")):
        wiring = wire(textbook(name), VOCABULARY)
        assert carried(wiring).aligned == (target, 0)


@pytest.mark.slow
@each_of("seed", range(150))
def test_what_the_checker_counts_as_known_is_what_assembly_can_compute(seed):
    rng = np.random.default_rng([11, seed])
    diagram = random_legal_diagram(rng)
    rewired = program_with_random_inputs(diagram, rng)
    for one in (diagram, rewired):
        wiring = wire(one, VOCABULARY)
        steady, flow = steady_order(wiring), carried(wiring)
        for name, kind in wiring.kinds.items():
            for port, signal in kind.outputs.items():
                channels = {(f"{name}.{port}", axis) for axis in range(signal.width)}
                if f"{name}.{port}" in steady.known:
                    assert flow.known >= channels
                elif not wiring.having(Element.PACK):  # of a packed pair assembly may know one axis
                    assert not flow.known >= channels
        parameters = {
            name: {key: box.typical for key, box in kind.parameters.items()}
            for name, kind in wiring.kinds.items()
        }
        if not unknown_equilibria(wiring):
            frame, found = equilibria(wiring, parameters, POINT, "capacitor", OMEGA_0)
            assert np.isfinite([*frame]).all()
            assert {(name, port) for name, ports in found.items() for port in ports} == {
                (name, port)
                for name, kind in wiring.kinds.items()
                for port in kind.equilibrium_ports
            }
        elif not wiring.having(Element.PACK):
            with pytest.raises(DiagramError, match="needs the operating point at"):
                equilibria(wiring, parameters, POINT, "capacitor", OMEGA_0)


def program_with_random_inputs(diagram, rng):
    """The same modules; the vector inputs of the controller take any vectors, also those behind
    integrators.
    """
    wiring = wire(diagram, VOCABULARY)
    vectors = [
        f"{n}.{port}"
        for n, kind in wiring.kinds.items()
        for port, one in kind.outputs.items()
        if one.width == 2
    ]
    other = type(diagram)("rewired")
    for one in diagram.instances:
        other.add(one.kind, one.name, **one.bindings)
    done = set()
    for one in diagram.connections:
        name, _, port = one.target.rpartition(".")
        kind = wiring.kinds.get(name)
        free = kind is not None and kind.family != "physical plant" and kind.inputs[port].width == 2
        if not free or kind.name == "Rot_v":
            other.connect(one.source, one.target)
        elif one.target not in done:
            done.add(one.target)
            other.connect(str(rng.choice(vectors)), one.target)
    return other


def test_to_frame_turns_a_vector_by_the_angle():
    z = to_frame((cos(0.3), sin(0.3)), (cos(0.3), sin(0.3)))
    assert z == pytest.approx((1.0, 0.0), abs=ROUNDING)
