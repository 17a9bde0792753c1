"""The nonlinear reference inverters and the two ways to sweep them."""

import numpy as np
import pytest
from collecting import each_of

from ibrid.errors import IbridError, OperatingPointError, SweepError
from ibrid.plants import (
    PLANTS,
    GFLParameters,
    frequency_grid,
    is_stable,
    operating_point,
    random_stable,
    state_space,
    sweep,
)
from ibrid.plants.sweeping import injected_admittance

PAPER_LIKE = PLANTS["paper_like"]
POINTS = ("p=1,q=0.3", "p=1,q=-0.3")
POWER_CONTROLLED = [
    name
    for name, plant in PLANTS.items()
    if isinstance(plant.parameters, GFLParameters)
    and (plant.parameters.p_loop, plant.parameters.q_loop) == ("power", "power")
]
J = np.array([[0.0, -1.0], [1.0, 0.0]])


@each_of("name", PLANTS)
@each_of("text", [*POINTS, "p=0,q=0", "p=-1.2,q=0.1,v=1.05"])
def test_nothing_moves_at_the_equilibrium(name, text):
    plant, op = PLANTS[name], operating_point(text)
    rest = plant.at_rest(op)
    rate = np.asarray(plant.dynamics.f(rest.x, [op.v, 0.0], rest.r)).ravel()
    # rounding of terms as large as omega_0 / L_F, a few times 1e4 per second
    assert np.abs(rate).max() < 1e-10


@pytest.mark.parametrize("text", [*POINTS, "p=-1.2,q=0", "p=0,q=0.5,v=0.95"])
def test_equilibrium_delivers_the_power_at_the_capacitor(text):
    op = operating_point(text)
    state = dict(zip(PAPER_LIKE.dynamics.states, PAPER_LIKE.equilibrium(op), strict=True))
    e = np.array([state["plant.e_d"], state["plant.e_q"]])
    i_g = np.array([state["plant.i_g_d"], state["plant.i_g_q"]])
    np.testing.assert_allclose([e @ i_g, e @ J @ i_g], [op.p, op.q], atol=1e-12)
    assert abs(state["plant.e_q"]) < 1e-12
    # the closed form: E^4 - (v^2 + 2a) E^2 + c = 0, its larger root
    m = PAPER_LIKE.parameters
    roots = np.roots(
        [
            1,
            -(op.v**2 + 2 * (m.R_g * op.p + m.L_g * op.q)),
            (m.R_g**2 + m.L_g**2) * (op.p**2 + op.q**2),
        ]
    )
    assert e[0] ** 2 == pytest.approx(roots.max(), abs=1e-12)


@each_of("name", POWER_CONTROLLED)
@each_of("text", POINTS)
def test_slow_admittance_keeps_p_and_q_constant(name, text):
    """At DC p and q at the measured node do not change, so with an L filter Y(0) = -[[p, -q], [-q,
    -p]] / v^2.
    """
    plant, op = PLANTS[name], operating_point(text)
    linear = state_space(plant, op)
    (Y,) = linear.admittance(np.array([1e-6]))
    i_DQ = np.asarray(plant.dynamics.g(linear.x_eq, [op.v, 0.0])).ravel()
    # behind an LCL filter the node is e = v + Z i at DC; there di_e = K de with the same identity
    m = plant.parameters
    Z = m.R_g * np.eye(2) + m.L_g * J
    e = np.array([op.v, 0.0]) + Z @ i_DQ
    dp = i_DQ @ (np.eye(2) + Z @ Y) + e @ Y
    # q = e' J i: dq = (J i)' de + (J' e)' di
    dq = (J @ i_DQ) @ (np.eye(2) + Z @ Y) + (J.T @ e) @ Y
    np.testing.assert_allclose(np.abs([*dp, *dq]), 0, atol=1e-5)
    if m.filter == "L":
        np.testing.assert_allclose(
            Y.real, -np.array([[op.p, -op.q], [-op.q, -op.p]]) / op.v**2, atol=1e-5
        )


def test_set_points_are_taken_as_they_are_written_at_the_prompt():
    frequency = np.geomspace(5.0, 500.0, 3)
    written = sweep("gfm_droop", ["p=0.5,q=0"], frequency)
    given = sweep("gfm_droop", [operating_point("p=0.5,q=0")], frequency)
    np.testing.assert_array_equal(written.points[0].Y, given.points[0].Y)


def test_admittance_at_minus_omega_is_the_conjugate():
    linear = state_space(PAPER_LIKE, operating_point(POINTS[0]))
    frequency = np.array([7.0, 130.0, 2500.0])
    np.testing.assert_allclose(
        linear.admittance(-frequency), linear.admittance(frequency).conj(), rtol=1e-12
    )


def test_high_frequency_admittance_is_that_of_the_grid_side_inductance():
    linear = state_space(PAPER_LIKE, operating_point(POINTS[0]))
    (Y,) = linear.admittance(np.array([1e6]))
    expected = -1 / (1e6 / 60 * 1j * PAPER_LIKE.parameters.L_g)
    np.testing.assert_allclose(Y, expected * np.eye(2), atol=1e-3 * abs(expected))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "frequency"),
    [
        ("paper_like", [8.0, 541.0, 2000.0]),
        ("touti_19kva", [20.0, 1000.0]),
        ("feng_50kva", [120.0]),
        ("kuleuven_600mva", [5000.0]),
    ],
)
def test_injection_and_linearisation_agree(name, frequency):
    plant, op = PLANTS[name], operating_point(POINTS[1])
    exact = state_space(plant, op).admittance(np.array(frequency))
    measured = injected_admittance(plant, op, np.array(frequency))
    error = np.linalg.norm(measured - exact, axis=(1, 2)) / np.linalg.norm(exact, axis=(1, 2))
    # steady state is recognised to 1e-4; the error found is below 3e-5
    assert error.max() < 1e-3


@pytest.mark.slow
def test_large_injection_shows_that_the_model_is_nonlinear():
    op, frequency = operating_point(POINTS[0]), np.array([500.0])
    exact = state_space(PAPER_LIKE, op).admittance(frequency)
    large = injected_admittance(PAPER_LIKE, op, frequency, amplitude=0.05)
    assert np.linalg.norm(large - exact) > 1e-3 * np.linalg.norm(exact)


@each_of("name", PLANTS)
def test_every_shipped_inverter_is_stable_where_it_is_swept(name):
    assert all(is_stable(PLANTS[name], op) for op in PLANTS[name].operating_points)


def test_published_sets_come_from_different_sources_and_sizes():
    published = [plant for name, plant in PLANTS.items() if name != "paper_like"]
    assert len({plant.source.split(",")[0] for plant in published}) >= 4
    sizes = [plant.s_base_va for plant in published if plant.s_base_va is not None]
    assert max(sizes) / min(sizes) > 1e4


def test_unit_feedforward_makes_the_sets_that_say_so_unstable():
    for name in ("sting_100mva", "feng_50kva"):
        plant = PLANTS[name].with_overrides(
            {"feedforward": 1.0, "L_decoupling": PLANTS[name].parameters.L_F}
        )
        assert not is_stable(plant, plant.operating_points[0])


def test_random_draws_are_stable_and_repeat_with_the_seed():
    first, again = (
        random_stable(np.random.default_rng(5), population="wide", pll_filter=True)
        for _ in range(2)
    )
    assert first == again
    assert all(is_stable(first, op, margin=1.0) for op in first.operating_points)


def test_overrides_take_diagram_names_and_field_names():
    plant = PAPER_LIKE.with_overrides(
        {"plant.L_F": 0.2, "kP_power": "0.01", "decoupling": "nominal"}
    )
    assert plant.parameters.L_F == 0.2
    assert plant.parameters.kP_power == 0.01
    # JMul counts in seconds
    assert plant.diagram_values["decoupling.L"] == pytest.approx(0.2 / plant.omega_0)
    assert '"JMul"' in plant.program


def test_noise_is_relative_to_the_norm_and_repeats_with_the_seed():
    frequency = frequency_grid("5:5000:200")
    clean = sweep("paper_like", None, frequency).points[0].admittance
    noisy, again = (
        sweep("paper_like", None, frequency, noise_db=40, seed=3).points[0].admittance
        for _ in range(2)
    )
    np.testing.assert_array_equal(noisy, again)
    relative = np.linalg.norm(noisy - clean, axis=(1, 2)) / np.linalg.norm(clean, axis=(1, 2))
    # 40 dB is 1 %; 1600 draws, so 5 % is three standard deviations and more
    assert np.sqrt((relative**2).mean()) == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: sweep("paper_lik", None, frequency_grid("5:50:3")), "paper_like"),
        (lambda: PAPER_LIKE.with_overrides({"plant.L_f": 0.1}), "plant.L_F"),
        (lambda: PAPER_LIKE.with_overrides({"plant.L_F": "big"}), "number"),
        (lambda: PAPER_LIKE.with_overrides({"L_F": -0.1}), "positive"),
        (lambda: PAPER_LIKE.with_overrides({"decoupling": "maybe"}), "nominal"),
        (lambda: sweep(PAPER_LIKE, None, frequency_grid("5:50:3"), repeats=3), "noise_db"),
        (lambda: random_stable(np.random.default_rng(0), population="tall"), "textbook"),  # type: ignore[arg-type]
    ],
)
def test_wrong_names_and_values_are_one_sentence_with_the_near_ones(call, words):
    with pytest.raises(IbridError, match=words) as raised:
        call()
    assert "\n" not in str(raised.value)


def test_an_unstable_or_missing_operating_point_is_refused():
    grid = frequency_grid("5:50:3")
    with pytest.raises(OperatingPointError, match="stable"):
        sweep(PAPER_LIKE, [operating_point("p=-1,q=0")], grid)
    with pytest.raises(OperatingPointError, match="does not exist"):
        sweep(PAPER_LIKE, [operating_point("p=1,q=0.3")], grid, overrides={"plant.L_g": 1.5})


def test_frequency_grid_includes_both_ends():
    grid = frequency_grid("5:5000:16")
    assert (grid[0], grid[-1], len(grid)) == (5.0, 5000.0, 16)
    np.testing.assert_allclose(grid[1:] / grid[:-1], 10 ** (3 / 15))


@each_of(
    "text",
    ["", "5:5000", "5:5000:16:2", "5000:5:16", "0:10:4", "a:b:c", "5:50:1", "5:nan:4", "5:inf:3"],
)
def test_malformed_frequencies_are_refused(text):
    with pytest.raises(SweepError, match="A:B:N"):
        frequency_grid(text)


def test_frequencies_of_four_numbers_are_told_that_three_are_wanted():
    with pytest.raises(SweepError, match=r"three numbers; found '5:50:3:4'"):
        frequency_grid("5:50:3:4")


def test_operating_point_text_names_the_point():
    op = operating_point(" p = 1.0, q = -0.30 ")
    assert (op.name, op.p, op.q, op.v) == ("p=1,q=-0.3", 1.0, -0.3, 1.0)
    assert operating_point("q=0,p=0.5,v=1.02").name == "p=0.5,q=0,v=1.02"


@each_of(
    "text",
    ["", "p=1", "p=1,q", "p=1,q=x", "p=1,q=0,v=0", "p=1,p=2,q=0", "p=1,q=0,s=1", "p=nan,q=0"],
)
def test_malformed_operating_points_are_refused(text):
    with pytest.raises(OperatingPointError, match=r"p=1,q=0\.3"):
        operating_point(text)
