"""Reference inverters beyond power-controlled grid-following ones: what they are, and that both
ways to sweep them agree.
"""

from dataclasses import fields, replace
from math import pi

import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants import PLANTS, GFLParameters, operating_point, state_space
from ibrid.plants.gfm import DroopParameters, GFMParameters, VSMParameters
from ibrid.plants.parallel import ParallelParameters
from ibrid.plants.published import BEYOND
from ibrid.plants.reference import ReferenceInverter
from ibrid.plants.sweeping import injected_admittance
from ibrid.structure import parse_program, structure_hash, textbook

GFL_L_FILTER, GFL_DC_LINK, GFM_DROOP, GFM_VSM, GFM_DVOC, HYBRID_GFL_GFM, PARALLEL_GFL_GFM = BEYOND
NAMES = [plant.name for plant in BEYOND]
#: Those whose fits take long.
LONG = ("gfm_droop", "gfm_vsm", "parallel_gfl_gfm")
POINTS = ("p=1,q=0.3", "p=1,q=-0.3", "p=-0.6,q=0.1,v=1.04")
FREQUENCY = np.geomspace(0.5, 1e4, 25)
J = np.array([[0.0, -1.0], [1.0, 0.0]])


def admittance(plant: ReferenceInverter, op: OperatingPoint) -> np.ndarray:
    """(K, 2, 2) of the linearisation."""
    return state_space(plant, op).admittance(FREQUENCY)


def largest_error(found: np.ndarray, wanted: np.ndarray) -> float:
    """Over frequencies, relative to |Y|_F there."""
    return float(
        (np.linalg.norm(found - wanted, axis=(1, 2)) / np.linalg.norm(wanted, axis=(1, 2))).max()
    )


def cascade_of(plant: ReferenceInverter) -> dict[str, float]:
    """Parameters that all grid-forming inverters have."""
    return {field.name: getattr(plant.parameters, field.name) for field in fields(GFMParameters)}


def states(plant: ReferenceInverter, op: OperatingPoint) -> dict[str, float]:
    return dict(zip(plant.dynamics.states, plant.equilibrium(op), strict=True))


def pair(state: dict[str, float], name: str) -> np.ndarray:
    return np.array([state[f"{name}_d"], state[f"{name}_q"]])


# what they are


@pytest.mark.parametrize("name", NAMES)
def test_plant_textbook_program_and_shipped_sweep_have_one_name(name):
    assert structure_hash(parse_program(PLANTS[name].program)) == structure_hash(textbook(name))
    assert name in ibrid.benchmarks()


@each_of("name", [name for name in NAMES if name != "parallel_gfl_gfm"])
@each_of("text", POINTS)
def test_p_and_q_at_rest_are_those_asked_for(name, text):
    plant, op = PLANTS[name], operating_point(text)
    state = states(plant, op)
    i_g = pair(state, "plant.i_g")
    if plant.power_node == "capacitor":
        e = pair(state, "plant.e")
    else:
        angle = state["pll.angle"]
        e = op.v * np.array([np.cos(angle), -np.sin(angle)])
    np.testing.assert_allclose([e @ i_g, e @ J @ i_g], [op.p, op.q], atol=1e-11)


@pytest.mark.parametrize("text", POINTS)
def test_the_dc_source_delivers_what_the_converter_takes(text):
    plant, op = GFL_DC_LINK, operating_point(text)
    state, m = states(plant, op), plant.parameters
    i_ti, i_g = pair(state, "plant.i_ti"), pair(state, "plant.i_g")
    delivered, loss = op.p, m.R_F * i_ti @ i_ti
    p_in, v_ref = plant.at_rest(op).r
    assert p_in == pytest.approx(delivered + loss, abs=1e-11)
    assert v_ref == pytest.approx(np.hypot(*pair(state, "plant.e")), abs=1e-12)
    assert state["dc_link.v_dc"] == pytest.approx(1.0, abs=1e-12)
    assert i_g @ i_g > 0


@pytest.mark.parametrize("text", POINTS)
def test_a_virtual_reactance_lies_between_the_amplitude_and_the_capacitor(text):
    for plant in (GFM_DROOP, GFM_VSM):
        op, m = operating_point(text), plant.parameters
        state, r = states(plant, op), plant.at_rest(op).r
        assert isinstance(m, GFMParameters)
        e_ref = pair(state, "plant.e") + m.X_virtual * J @ pair(state, "plant.i_g")
        assert e_ref[1] == pytest.approx(0.0, abs=1e-11)
        assert (r[0], r[1]) == pytest.approx((op.p, e_ref[0] + m.m_q * op.q), abs=1e-11)  # type: ignore[attr-defined]


@pytest.mark.parametrize("text", POINTS)
def test_the_set_points_of_the_oscillator_are_its_operating_point(text):
    op = operating_point(text)
    size = np.hypot(*pair(states(GFM_DVOC, op), "plant.e"))
    assert tuple(GFM_DVOC.at_rest(op).r) == pytest.approx((op.p, op.q, size**2), abs=1e-11)


@pytest.mark.parametrize("text", POINTS)
def test_two_inverters_behind_one_pcc_share_p_and_q_and_their_currents_add_up(text):
    op, m = operating_point(text), PARALLEL_GFL_GFM.parameters
    assert isinstance(m, ParallelParameters)
    state = states(PARALLEL_GFL_GFM, op)
    whole = np.asarray(PARALLEL_GFL_GFM.dynamics.g([*state.values()], [op.v, 0.0])).ravel()
    np.testing.assert_allclose(op.v * whole, [op.p, -op.q], atol=1e-11)
    followed = pair(state, "following.plant.i_g")
    angle = state["following.pll.angle"]
    own = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ followed
    np.testing.assert_allclose(op.v * own, [m.share_p * op.p, -m.share_q * op.q], atol=1e-11)


@pytest.mark.parametrize("text", POINTS)
def test_the_admittance_of_two_inverters_is_the_sum_of_those_that_each_has_with_its_share(text):
    op, m = operating_point(text), PARALLEL_GFL_GFM.parameters
    assert isinstance(m, ParallelParameters)
    first = replace(op, p=m.share_p * op.p, q=m.share_q * op.q)
    second = replace(op, p=op.p - first.p, q=op.q - first.q)
    # the grid-forming one counts p and q at its capacitor: what it has there when the PCC gets its
    # share
    i = np.array([second.p, -second.q]) / op.v
    e = np.array([op.v, 0.0]) + (m.forming.R_g * np.eye(2) + m.forming.L_g * J) @ i
    at_capacitor = replace(second, p=float(e @ i), q=float(e @ J @ i))
    alone = admittance(GFL_L_FILTER, first) + admittance(GFM_DROOP, at_capacitor)
    assert largest_error(admittance(PARALLEL_GFL_GFM, op), alone) < 1e-9


# identities between them


def test_a_machine_without_pll_damping_is_a_droop_behind_a_low_pass():
    machine = replace(GFM_VSM.parameters, k_d=0.0)
    assert isinstance(machine, VSMParameters)
    droop = DroopParameters(
        **cascade_of(GFM_VSM),
        m_p=GFM_VSM.omega_0 / machine.k_w,
        omega_p=machine.k_w / machine.T_a,
        m_q=machine.m_q,
        omega_q=machine.omega_q,
    )
    for text in POINTS:
        one, other = (
            admittance(replace(GFM_VSM, parameters=m), operating_point(text))
            for m in (machine, droop)
        )
        assert largest_error(one, other) < 1e-9


def test_an_oscillator_rotated_by_90_degrees_is_a_pair_of_droops():
    """delta_omega = -eta/E^2 dp, dE = -eta/(2 alpha E^3) dq behind a low-pass of 2 alpha E^2."""
    op = operating_point(POINTS[0])
    oscillator = replace(GFM_DVOC, parameters=replace(GFM_DVOC.parameters, kappa=pi / 2))  # type: ignore[call-arg]
    E, m = float(np.hypot(*pair(states(oscillator, op), "plant.e"))), GFM_DVOC.parameters
    droop = DroopParameters(
        **cascade_of(GFM_DVOC),
        m_p=m.eta / E**2,  # type: ignore[union-attr]
        omega_p=1e9,
        m_q=m.eta / (2 * m.alpha * E**3),  # type: ignore[union-attr]
        omega_q=2 * m.alpha * E**2,  # type: ignore[union-attr]
    )
    # the low-pass on p that the oscillator lacks changes the phase at 10 kHz by 6e-5
    assert (
        largest_error(
            admittance(replace(GFM_DVOC, parameters=droop), op), admittance(oscillator, op)
        )
        < 1e-4
    )


def test_a_hybrid_whose_weight_is_the_plls_follows_the_grid():
    h = HYBRID_GFL_GFM.parameters
    same = (
        "L_F",
        "R_F",
        "C_F",
        "L_g",
        "R_g",
        "kP_pll",
        "kI_pll",
        "kP_power",
        "kI_power",
        "omega_c_power",
    )
    following = GFLParameters(
        **{name: getattr(h, name) for name in (*same, "kP_current", "kI_current")}, feedforward=0.0
    )
    nearly = replace(h, weight=1 - 1e-12)  # type: ignore[call-arg]
    for text in POINTS:
        one, other = (
            admittance(replace(HYBRID_GFL_GFM, parameters=m), operating_point(text))
            for m in (nearly, following)
        )
        assert largest_error(one, other) < 1e-9


@pytest.mark.parametrize("text", POINTS)
def test_slow_changes_of_voltage_leave_what_integrators_hold(text):
    """On a stiff grid the frequency is the grid's, so droop and machine hold p, and the DC link
    holds what it gets.
    """
    op = operating_point(text)
    for plant in (GFL_DC_LINK, GFM_DROOP, GFM_VSM):
        linear, m = state_space(plant, op), plant.parameters
        (Y,) = linear.admittance(np.array([1e-6]))
        i = np.asarray(plant.dynamics.g(linear.x_eq, [op.v, 0.0])).ravel()
        e = np.array([op.v, 0.0]) + (m.R_g * np.eye(2) + m.L_g * J) @ i
        de = np.eye(2) + (m.R_g * np.eye(2) + m.L_g * J) @ Y
        i_ti = i + m.C_F * J @ e
        if plant is GFL_DC_LINK:
            held = i @ de + e @ Y + 2 * m.R_F * i_ti @ (Y + m.C_F * J @ de), e @ de
        else:
            held = (i @ de + e @ Y,)
        # Y is real at DC but for 1e-6 Hz over the slowest pole
        np.testing.assert_allclose(np.abs(np.concatenate(held)), 0, atol=1e-5)


# both ways to sweep them, and to fit them


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_injection_and_linearisation_agree(name):
    plant, op, frequency = PLANTS[name], operating_point(POINTS[1]), np.array([23.0, 310.0, 2600.0])
    exact = state_space(plant, op).admittance(frequency)
    # steady state is recognised to 1e-4
    assert largest_error(injected_admittance(plant, op, frequency), exact) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.nightly if name in LONG else ()) for name in NAMES],
)
def test_the_textbook_program_fits_the_shipped_sweep(name):
    record = ibrid.evaluate(ibrid.textbook(name), ibrid.read_sweep(ibrid.benchmarks()[name]))
    assert record.nrmse is not None
    assert record.nrmse < 1e-9
    assert all(record.stable.values())


# wrong inputs


@each_of(
    ("call", "words"),
    [
        (lambda: GFM_DROOP.with_overrides({"p_droop.k": -3.0}), "no parameter p_droop.k"),
        (
            lambda: GFM_DROOP.with_overrides({"m_p": -3.0}),
            "m_p of a grid-forming inverter must be positive; found -3",
        ),
        (lambda: GFM_DVOC.with_overrides({"oscillator.eta": "fast"}), "number"),
        (lambda: HYBRID_GFL_GFM.with_overrides({"weight": 1.0}), "below 1"),
        (lambda: GFL_DC_LINK.with_overrides({"p_loop": "droop"}), "power, dc_link"),
        (lambda: GFL_DC_LINK.with_overrides({"p_loop": "power"}), "kI_power"),
        (lambda: PLANTS["paper_like"].with_overrides({"q_loop": "voltage"}), "kI_ac"),
        (lambda: PARALLEL_GFL_GFM.with_overrides({"following": 1.0}), "no parameter following"),
        (
            lambda: GFM_DVOC.with_overrides({"X_virtual": 0.1}),
            "X_virtual belongs to no part that gfm_dvoc has",
        ),
        (
            lambda: PLANTS["gfl_l_filter"].with_overrides({"kP_pll": 50, "plant.C_F": 0.1}),
            "plant.C_F belongs to no part",
        ),
        (
            lambda: PLANTS["paper_like"].with_overrides({"filter": "L", "C_F": 0.1}),
            "C_F belongs to no part",
        ),
        (lambda: PARALLEL_GFL_GFM.with_overrides({"gfl_share.share_p": float("nan")}), "share_p"),
    ],
)
def test_wrong_names_and_values_are_one_sentence(call, words):
    with pytest.raises(IbridError, match=words) as raised:
        call()
    assert "\n" not in str(raised.value)


def test_overrides_take_diagram_names_where_diagram_and_equations_share_a_number():
    plant = GFM_VSM.with_overrides({"plant.L_g": 0.1, "pll.kP_pll": 40.0, "k_d": 100.0})
    values = plant.diagram_values
    assert (values["plant.L_g"], values["pll.kP_pll"]) == (0.1, 40.0)
    assert values["pll_damping.k"] == pytest.approx(100 / 120)
