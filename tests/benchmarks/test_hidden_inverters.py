"""The hidden inverters of the search benchmark are stable, are what they say, and are unknown to
the search.
"""

import ast
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.search.hidden import FREQUENCY, HALF_LOAD, Hidden, exact_model
from ibrid_bench.search.inverters import (
    DIAGRAMS,
    HARDWARE,
    hardware,
    inverter,
    inverter_names,
    plant_of,
)
from sharing import shared

import ibrid
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep
from ibrid.plants import state_space

SEARCH = Path(__file__).resolve().parents[2] / "search" / "ibrid_search"
NAMES = inverter_names()


@shared
def hidden(name: str) -> Hidden:
    return inverter(name)


def points(one: Hidden) -> tuple[PointSweep, ...]:
    """Those that the search sees and the one that it does not."""
    assert one.held_out is not None
    return (*one.sweep.points, *one.held_out.points)


@shared
def model(name: str) -> Record:
    one = hidden(name)
    assert one.values is not None
    at = [point.op for point in points(one)]
    return exact_model(one.program, one.values, at, one.sweep.f0_hz, one.sweep.power_node)


def assert_close(found: np.ndarray, wanted: np.ndarray, tolerance: float) -> None:
    """At each frequency relative to the largest entry there."""
    scale = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    assert (np.abs(found - wanted) <= tolerance * scale).all()


@each_of("name", NAMES)
def test_a_hidden_inverter_is_legal_and_stable_at_its_three_points(name):
    assert ibrid.violations(hidden(name).truth) == ()
    assert len(model(name).parameters) == 3
    for op in model(name).parameters:
        assert np.real(model(name).state_space(op).poles()).max() < 0


@each_of("name", NAMES)
def test_its_sweep_is_the_response_of_its_diagram(name):
    for point in points(hidden(name)):
        assert (len(point.frequency), point.frequency[0], point.frequency[-1]) == (16, 5.0, 5000.0)
        # 1e-9: the shipped files, at a lightly damped resonance by another linear algebra library
        assert_close(model(name).response(point.op.name, point.frequency), point.admittance, 1e-9)


@each_of("name", [name for name in NAMES if plant_of(name)])
def test_its_sweep_is_the_linearisation_of_the_nonlinear_inverter(name):
    plant = plant_of(name)
    assert plant is not None
    assert hidden(name).sweep.f0_hz == plant.f0_hz
    for point in points(hidden(name)):
        assert_close(
            point.admittance, state_space(plant, point.op).admittance(point.frequency), 1e-8
        )


def test_the_search_sees_two_points_and_never_the_held_out_one():
    for name in NAMES:
        one = hidden(name)
        assert one.held_out is not None
        assert [(point.op.p, point.op.q, point.op.v) for point in one.sweep.points] == [
            (1, 0.3, 1),
            (1, -0.3, 1),
        ]
        ((held),) = one.held_out.points
        # one random draw is unstable at half load
        assert held.op == HALF_LOAD or name == "random_04"
        assert held.op.name not in one.sweep.names


J = np.array([[0.0, -1.0], [1.0, 0.0]])
OMEGA_0 = 2 * np.pi * 60
# the unknowns in the controller's frame: i_ti, e, i_g and the deviation of its frequency
I_TI, E, I_G, OMEGA = np.eye(7)[0:2], np.eye(7)[2:4], np.eye(7)[4:6], np.eye(7)[6]
#: (s, values, p, q as rows of the unknowns, i_ti at rest) -> (u_r, the deviation of frequency) as
#: rows of the unknowns.
Control = Callable[..., tuple[np.ndarray, np.ndarray]]


def by_hand(control: Control, values: dict[str, float], op: OperatingPoint) -> np.ndarray:
    """Admittance from the equations of the LCL filter and a control law, solved as they stand at
    every frequency.

    The frame is that of the capacitor voltage, which the PLL or the voltage loop puts on the d
    axis.
    """
    L_F, R_F, C_F, L_g, R_g = (
        values[f"plant.{name}"] for name in ("L_F", "R_F", "C_F", "L_g", "R_g")
    )
    # at rest, e on the d axis: p and q give i_g, and e - Z i_g has the magnitude v
    b = op.v**2 + 2 * (R_g * op.p + L_g * op.q)
    e_eq = np.array(
        [np.sqrt((b + np.sqrt(b**2 - 4 * (R_g**2 + L_g**2) * (op.p**2 + op.q**2))) / 2), 0.0]
    )
    i_g_eq = np.array([op.p, -op.q]) / e_eq[0]
    i_ti_eq = i_g_eq + C_F * J @ e_eq
    v_eq = e_eq - (R_g * np.eye(2) + L_g * J) @ i_g_eq
    turn = (
        np.array([v_eq, J @ v_eq]).T / op.v
    )  # R(delta_eq): the terminal voltage is on the D axis of the grid
    p, q = i_g_eq @ E + e_eq @ I_G, (J @ i_g_eq) @ E + (J.T @ e_eq) @ I_G
    found = []
    for s in 2j * np.pi * FREQUENCY:

        def drop(
            R: float, L: float, z: np.ndarray, at_rest: np.ndarray, s: complex = s
        ) -> np.ndarray:
            """Voltage over R and L, or current into a capacitance, in a frame that turns with
            omega_0 + OMEGA.
            """
            return ((R + s * L / OMEGA_0) * np.eye(2) + L * J) @ z + L / OMEGA_0 * np.outer(
                J @ at_rest, OMEGA
            )

        u_r, omega = control(s, values, p, q, i_ti_eq)
        angle = OMEGA / s
        rows = np.vstack(
            [
                drop(R_F, L_F, I_TI, i_ti_eq) + E - u_r,
                drop(0.0, C_F, E, e_eq) + I_G - I_TI,
                drop(R_g, L_g, I_G, i_g_eq) - E - np.outer(J @ v_eq, angle),
                OMEGA - omega,
            ]
        )
        forcing = np.zeros((7, 2))
        forcing[4:6] = -turn
        z = np.linalg.solve(rows, forcing)
        found.append(turn.T @ (I_G + np.outer(J @ i_g_eq, angle)) @ z)
    return np.array(found)


def pi(values: dict[str, float], name: str, s: complex) -> complex:
    return values[f"{name}.kP"] + values[f"{name}.kI"] / s


def low_pass(values: dict[str, float], name: str, s: complex) -> complex:
    return 1 / (1 + s / values[f"{name}.omega_c"])


def following(s, values, p, q, i_ti_eq, *, i: np.ndarray = I_TI, gains=("power", "power")):
    """PLL, power control, current control with decoupling by the PLL frequency; u_r without the
    voltage.
    """
    omega = (values["pll.kP_pll"] + values["pll.kI_pll"] / s) * E[1]
    i_ref = np.array([-pi(values, gains[0], s) * p, pi(values, gains[1], s) * q])
    L = values["decoupling.L"]
    return pi(values, "current", s) * (i_ref - i) + L * (
        J @ i + np.outer(J @ i_ti_eq, OMEGA) / OMEGA_0
    ), omega


def filtered_feedforward(s, values, *rest):
    u_r, omega = following(s, values, *rest)
    return u_r + low_pass(values, "feedforward", s) * E, omega


def delay(s, values, *rest):
    u_r, omega = following(s, values, *rest)
    return np.exp(-1.5e-4 * s) * (u_r + E), omega


def unusual(s, values, *rest):
    i = low_pass(values, "current_filter", s) * I_TI
    u_r, omega = following(s, values, *rest, i=i, gains=("p_loop", "q_loop"))
    return u_r + values["damping.k"] * (I_TI - I_G), omega


def droop(s, values, p, q, i_ti_eq):
    slow = low_pass(values, "power_filter", s)
    e_ref = np.vstack([values["q_droop.k"] * slow * q, np.zeros(7)])
    i_ref = pi(values, "voltage", s) * (e_ref - E)
    return pi(values, "current", s) * (i_ref - I_TI) + E, values["p_droop.k"] * slow * p


@pytest.mark.parametrize(
    ("name", "control"),
    [(one.__name__, one) for one in (filtered_feedforward, delay, unusual, droop)],
)
def test_a_diagram_without_a_nonlinear_model_solves_its_equations(name, control):
    assert set(DIAGRAMS) == {"filtered_feedforward", "delay", "unusual", "droop"}
    for point in points(hidden(name)):
        assert_close(
            point.admittance, by_hand(control, dict(hidden(name).values or {}), point.op), 1e-9
        )


def test_the_delayed_inverter_is_stable_whatever_the_pade_order():
    used = model("delay")
    finer = replace(
        used,
        settings={
            **used.settings,
            "pade_orders": {"delay": 2 * used.settings["pade_orders"]["delay"]},
        },
    )
    for op in used.parameters:
        rightmost = [
            max(one.state_space(op).poles(), key=lambda pole: pole.real) for one in (used, finer)
        ]
        assert rightmost[0] == pytest.approx(rightmost[1], rel=1e-6)


def test_the_unusual_inverter_is_in_no_textbook_program():
    truth = hidden("unusual").truth
    assert truth is not None
    for name in ibrid.textbook_names():
        comparison = ibrid.compare(ibrid.textbook(name), truth)
        assert comparison.modules.f1 < 0.9 or comparison.connections.f1 < 0.9


def test_noise_has_its_level_and_seed_and_leaves_the_held_out_point_clean():
    clean = hidden("paper_like")
    noisy = clean.noisy(40, 3)
    again, other = clean.noisy(40, 3), clean.noisy(40, 4)
    for point, before, same, different in zip(
        noisy.sweep.points, clean.sweep.points, again.sweep.points, other.sweep.points, strict=True
    ):
        error = np.linalg.norm(point.admittance - before.admittance) / np.linalg.norm(
            before.admittance
        )
        # 40 dB are 1 % on average; 128 numbers scatter by less than a third
        assert error == pytest.approx(0.01, rel=0.5)
        assert point.sigma is not None
        np.testing.assert_array_equal(point.admittance, same.admittance)
        assert (point.admittance != different.admittance).all()
    assert noisy.held_out is clean.held_out
    assert noisy.program == clean.program


def test_hardware_has_no_truth_and_is_left_out_where_it_is_not():
    for one in hardware():
        assert one.truth is None
        assert one.values is None
        assert one.sweep.power_node == "pcc"


def test_missing_hardware_and_unknown_names_get_one_sentence(monkeypatch, tmp_path):
    monkeypatch.setenv("IBRID_HARDWARE_DATA", str(tmp_path))
    assert list(hardware()) == []
    with pytest.raises(IbridError, match="IBRID_HARDWARE_DATA"):
        inverter(HARDWARE[0])
    with pytest.raises(IbridError, match="droop"):
        inverter("drop")


def imports(path: Path) -> set[str]:
    """Dotted names that a file imports, and every text in it that could name a module."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


OWN = sorted(SEARCH.rglob("*.py"))


@each_of("path", OWN, ids=lambda path: str(path.relative_to(SEARCH)))
def test_the_search_never_looks_at_the_hidden_inverters(path):
    assert not [name for name in imports(path) if name.startswith("ibrid_bench")]


def test_the_proposers_know_no_inverter_of_ours():
    """Neither the reference inverters nor the textbook programs, but what every engineer knows."""
    files = sorted((SEARCH / "proposers").rglob("*.py"))
    for path in files:
        known = [
            name
            for name in imports(path)
            if name.startswith(("ibrid.plants", "ibrid.structure.diagrams.library"))
        ]
        assert not known, path.name
