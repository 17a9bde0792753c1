"""The port map: an open transfer is the same model at Delta = 0, any block at another, and is
measured where one is hidden.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from collecting import each_of
from fitted import TRUE
from sharing import shared

from ibrid.assembly.symbolic import symbolic_model
from ibrid.errors import IbridError
from ibrid.fit.problem import Problem
from ibrid.gap.ports.open_port import OpenPort
from ibrid.gap.ports.port_fit import PortProblem, eliminate_transfer
from ibrid.gap.ports.port_map import PortFit, port_map
from ibrid.gap.ports.ports import Port, ports
from ibrid.gap.refitting.prior import NominalValue, ParameterPrior
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules import PAPER_VOCABULARY, VOCABULARY
from ibrid.parts.catalogue import insertions
from ibrid.structure import Diagram, parameter_table, textbook, textbook_names, wire
from ibrid.structure.editing.drafting import Draft

FREQUENCY = np.geomspace(5.0, 5000.0, 16)
S = 2j * np.pi * FREQUENCY
OMEGA_0 = 2 * np.pi * 60
POINTS = (OperatingPoint("p=1,q=0.3", 1.0, 0.3), OperatingPoint("p=1,q=-0.3", 1.0, -0.3))
NAMES = [
    name for name in textbook_names() if name not in ("naive", "parallel_gfl_gfm")
]  # with one plant


def problem(diagram: Diagram) -> Problem:
    model = symbolic_model(
        wire(diagram, VOCABULARY), equilibrium="exact", power_node="capacitor", omega_0=OMEGA_0
    )
    return Problem(model, [PointSweep(op, FREQUENCY, np.ones((16, 2, 2))) for op in POINTS])


def vector(diagram: Diagram, values: dict[str, float]) -> np.ndarray:
    return np.array(
        [values[one.name] for one in parameter_table(wire(diagram, VOCABULARY), "exact").free]
    )


def swept(diagram: Diagram, values: dict[str, float]) -> Sweep:
    """The exact admittance of a diagram."""
    model = problem(diagram)
    found = model.responses(model.coordinates.to_x(vector(diagram, values)))
    return Sweep(tuple(PointSweep(op, FREQUENCY, y) for op, y in zip(POINTS, found, strict=True)))


def measured(sweep: Sweep) -> np.ndarray:
    """(K, M, 2, 2)."""
    return np.stack([one.admittance for one in sweep.points], axis=1)


def noisy(sweep: Sweep, seed: int = 0, noise_db: float = 60.0) -> Sweep:
    return add_noise(sweep, noise_db, rng=np.random.default_rng(seed))


def typical(diagram: Diagram) -> dict[str, float]:
    return {
        one.name: one.typical for one in parameter_table(wire(diagram, VOCABULARY), "exact").free
    }


def values_of(diagram: Diagram, given: dict[str, float] | None = None) -> dict[str, float]:
    """Those of the benchmark inverter, by name, and given ones."""
    known = {**TRUE, **(given or {})}
    return {name: known.get(name, value) for name, value in typical(diagram).items()}


def port_called(diagram: Diagram, name: str) -> Port:
    (found,) = [one for one in ports(diagram, VOCABULARY) if one.name == name]
    return found


def opened(port: Port, values: dict[str, float], sweep: Sweep | None = None):
    model = OpenPort(
        port, VOCABULARY, sweep or swept(textbook("gfl_exact"), values_of(textbook("gfl_exact")))
    )
    return model.at(np.array([values[one.name] for one in model.symbolic.parameters]))


# hidden effects, each with the port at which it lies and its law


@dataclass(frozen=True)
class HiddenEffect:
    """`effect`, `change`, `where` : of the catalogue's insertion. `strength` : new parameters.
    `law` : Delta(s).
    """

    port: str
    effect: str
    change: str
    where: str
    strength: dict[str, float]
    law: Callable[[np.ndarray], np.ndarray]

    def given(self) -> Diagram:
        """The model that lacks the effect."""
        draft = Draft(textbook("gfl_exact"), VOCABULARY)
        if self.effect == "decoupling":
            draft.remove("decoupling")
        return draft.diagram()

    def device(self) -> Sweep:
        """What is measured."""
        (found,) = [
            one
            for one in insertions(self.given(), VOCABULARY)
            if (one.effect, one.change) == (self.effect, self.change) and self.where in one.where
        ]
        assert found.parameters.keys() == self.strength.keys()
        return swept(found.diagram, values_of(found.diagram, self.strength))


HZ = 2 * np.pi


def low_pass(hertz: float) -> Callable[[np.ndarray], np.ndarray]:
    """What a low-pass in series adds to 1."""
    return lambda s: -s / (s + HZ * hertz)


HIDDEN = {
    "control_delay": HiddenEffect(
        "plant.u_r",
        "control_delay",
        "add",
        "",
        {"delay.T_d": 1.5e-4},
        lambda s: np.exp(-1.5e-4 * s) - 1,
    ),
    "pll_prefilter": HiddenEffect(
        "pll.e_q", "pll_prefilter", "add", "LPF1", {"pll_filter.omega_c": HZ * 100}, low_pass(100)
    ),
    "power_filter": HiddenEffect(
        "power.p and power.q",
        "power_filter",
        "add",
        "one corner",
        {"power_filter.omega_c": HZ * 30},
        low_pass(30),
    ),
    "current_filter": HiddenEffect(
        "plant.i_ti",
        "current_filter",
        "add",
        "and decoupling",
        {"current_filter.omega_c": HZ * 1500},
        low_pass(1500),
    ),
    "current_filter_of_the_loop": HiddenEffect(
        "minus_i.in_",
        "current_filter",
        "add",
        "alone",
        {"current_filter.omega_c": HZ * 1500},
        low_pass(1500),
    ),
    "voltage_feedforward": HiddenEffect(
        "plant.e -> plant.u_r", "voltage_feedforward", "remove", "", {}, lambda s: -1 + 0 * s
    ),
    "active_damping": HiddenEffect(
        "plant.i_C -> plant.u_r",
        "active_damping",
        "add",
        "high-passed",
        {"active_damping.k": 0.2, "damping_filter.omega_c": HZ * 200},
        lambda s: -0.2 * s / (s + HZ * 200),
    ),
    "decoupling": HiddenEffect(
        "J plant.i_ti -> plant.u_r",
        "decoupling",
        "add",
        "(JMul)",
        {"decoupling.L": 0.2 / OMEGA_0},
        lambda s: 0.2 + 0 * s,
    ),
    "frequency_droop": HiddenEffect(
        "pll.delta_omega -> p_loop.in_",
        "frequency_droop",
        "add",
        "low-pass",
        {"frequency_droop.k": 0.026, "droop_filter.omega_c": HZ * 5},
        lambda s: -0.026 * HZ * 5 / (s + HZ * 5),
    ),
    "ac_voltage_loop": HiddenEffect(
        "|plant.e| -> i_ref.in_q in place of q_loop",
        "ac_voltage_loop",
        "replace",
        "",
        {"ac_voltage.kP": 0.2, "ac_voltage.kI": 30.0},
        lambda s: 0.2 + 30.0 / s,
    ),
    "dc_link": HiddenEffect(
        "power at plant.u_r -> i_ref.in_d in place of p_loop",
        "dc_link",
        "replace",
        "",
        {"dc_link.C_dc": 0.02, "dc_voltage.kP": 1.5, "dc_voltage.kI": 50.0},
        lambda s: -(1.5 + 50.0 / s) / (0.02 * s),
    ),
}


#: Source, target and the loop in whose place the path is.
REPLACED = [("|plant.e|", "i_ref.in_q", "q_loop"), ("power at plant.u_r", "i_ref.in_d", "p_loop")]


# the ports


@pytest.mark.nightly
@each_of("name", NAMES)
def test_a_textbook_inverter_has_twelve_to_twenty_ports_of_different_names_and_its_own_parameters(
    name,
):
    diagram = textbook(name)
    found = ports(diagram, VOCABULARY)
    assert 12 <= len(found) <= 20
    assert len({one.name for one in found}) == len({one.words for one in found}) == len(found)
    own = list(typical(diagram))
    sweep = swept(diagram, values_of(diagram))
    for one in found:
        assert [each.name for each in OpenPort(one, VOCABULARY, sweep).symbolic.parameters] == own


def test_ports_need_no_kind_beyond_the_papers_but_for_the_size_of_a_voltage():
    names = {one.name for one in ports(textbook("gfl"), PAPER_VOCABULARY)}
    assert {one.name for one in ports(textbook("gfl"), VOCABULARY)} - names == {
        "|plant.e| -> i_ref.in_q",
        "|plant.e| -> i_ref.in_q in place of q_loop",
    }


def test_a_bare_plant_has_the_ports_of_its_command_and_of_its_terminals():
    assert [one.name for one in ports(textbook("naive"), VOCABULARY)] == [
        "plant.u_r",
        "plant.e -> plant.u_r",
        "plant.i_g -> plant.u_r",
        "J plant.i_g -> plant.u_r",
        "v_DQ -> i_DQ",
        "J v_DQ -> i_DQ",
    ]


# the open model


@pytest.mark.nightly
@each_of("name", NAMES)
def test_delta_of_zero_leaves_admittance_and_slopes_of_the_compiled_model_unchanged(name):
    diagram = textbook(name)
    model = problem(diagram)
    theta = vector(diagram, values_of(diagram))
    x = model.coordinates.to_x(theta)
    wanted, slope = np.stack(model.responses(x), axis=1), np.stack(model.jacobians(x), axis=1)
    sweep = swept(diagram, values_of(diagram))
    for port in ports(diagram, VOCABULARY):
        if " in place of " in port.name:
            continue
        at = OpenPort(port, VOCABULARY, sweep).at(theta)
        assert at is not None
        ones = np.ones(16, dtype=complex)
        np.testing.assert_allclose(
            at.response(ones), wanted, rtol=0, atol=1e-12 * np.abs(wanted).max()
        )
        found = at.slope_by_parameters(ones) * model.coordinates.slope(theta)
        np.testing.assert_allclose(found, slope, rtol=0, atol=1e-11 * np.abs(slope).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "target", "loop"),
    [("|plant.e|", "i_ref.in_q", "q_loop"), ("power at plant.u_r", "i_ref.in_d", "p_loop")],
)
def test_in_place_of_a_loop_delta_of_zero_is_the_model_without_that_loop(source, target, loop):
    diagram = textbook("gfl_exact")
    draft = Draft(diagram, VOCABULARY)
    draft.remove(loop)
    draft.tidy()
    wanted = measured(swept(draft.diagram(), values_of(draft.diagram())))
    port = port_called(diagram, f"{source} -> {target} in place of {loop}")
    found = opened(port, values_of(diagram)).response(np.ones(16, dtype=complex))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.nightly
@each_of("hidden", HIDDEN.values(), ids=HIDDEN)
def test_with_the_law_of_an_effect_the_open_model_is_that_with_the_effect(hidden):
    given, device = hidden.given(), hidden.device()
    found = opened(port_called(given, hidden.port), values_of(given)).response(1 + hidden.law(S))
    np.testing.assert_allclose(found, measured(device), rtol=0, atol=1e-9 * np.abs(found).max())


@pytest.mark.slow
@each_of("port", ports(textbook("gfl_delay"), VOCABULARY), ids=lambda port: port.name)
def test_slopes_by_the_transfer_and_the_parameters_are_those_of_differences(port):
    diagram, rng = textbook("gfl_delay"), np.random.default_rng(0)
    values = values_of(diagram)
    model = OpenPort(port, VOCABULARY, swept(diagram, values))
    theta = vector(diagram, values)
    g = 1 + 0.3 * (rng.standard_normal(16) + 1j * rng.standard_normal(16))
    at, step = model.at(theta), 1e-5
    by_g = at.slope_by_transfer(g)
    for turn in (1, 1j):  # analytic: the same along both axes
        difference = (at.response(g + turn * step) - at.response(g - turn * step)) / (
            2 * turn * step
        )
        np.testing.assert_allclose(difference, by_g, rtol=0, atol=1e-7 * np.abs(by_g).max())
    by_theta = at.slope_by_parameters(g)
    for index, value in enumerate(theta):
        move = step * value * (np.arange(len(theta)) == index)
        difference = (model.at(theta + move).response(g) - model.at(theta - move).response(g)) / (
            2 * step * value
        )
        np.testing.assert_allclose(
            difference, by_theta[..., index], rtol=0, atol=1e-6 * np.abs(by_theta[..., index]).max()
        )


@pytest.mark.nightly
@each_of("hidden", HIDDEN.values(), ids=HIDDEN)
def test_without_noise_the_true_parameters_give_the_transfer_at_once(hidden):
    given, device = hidden.given(), hidden.device()
    at = opened(port_called(given, hidden.port), values_of(given))
    data = measured(device)
    weight = np.broadcast_to(1e9 / np.linalg.norm(data, axis=(2, 3))[..., None, None], data.shape)
    g = eliminate_transfer(at, PortProblem(data, weight, ParameterPrior([], {})))
    np.testing.assert_allclose(at.response(g), data, rtol=0, atol=1e-9 * np.abs(data).max())
    seen = np.abs(weight * at.slope_by_transfer(g)).max(axis=(1, 2, 3)) > 1e6
    assert seen.sum() >= 12
    # the prior of Delta draws less than 1/1e6^2 of it
    np.testing.assert_allclose(g[seen], 1 + hidden.law(S)[seen], rtol=0, atol=1e-8)


# the map

#: Standard errors within which each real and imaginary part lies; one of 16 000 is farther off by
#: chance.
DEVIATIONS = 4.0


def off(values: dict[str, float], seed: int = 1) -> dict[str, float]:
    """Values that an engineer believes in: 10 % wrong."""
    rng = np.random.default_rng(seed)
    return {name: value * np.exp(0.1 * rng.standard_normal()) for name, value in values.items()}


def believed(values: dict[str, float], width: float | None = None) -> dict[str, NominalValue]:
    """The prior that goes with values."""
    usual = {name: 0.25 if name.startswith("plant.") else np.log(2) for name in values}
    return {name: NominalValue(value, width or usual[name]) for name, value in values.items()}


def mapped(diagram: Diagram, sweep: Sweep, **options) -> tuple[PortFit, ...]:
    nominal = off(values_of(diagram))
    return port_map(diagram, VOCABULARY, sweep, believed(nominal), [nominal], **options)


def farthest(fit: PortFit, law: np.ndarray, seen: np.ndarray) -> float:
    """How far a transfer is from its law where it is seen, in standard errors of one part."""
    wrong = fit.transfer - law
    return max(
        np.abs(wrong.real / fit.deviation)[seen].max(),
        np.abs(wrong.imag / fit.deviation)[seen].max(),
    )


@shared
def map_of(name: str) -> tuple[PortFit, ...]:
    """All ports for a sweep with an effect hidden, 60 dB."""
    return mapped(HIDDEN[name].given(), noisy(HIDDEN[name].device()))


@shared
def map_of_nothing() -> tuple[PortFit, ...]:
    given = textbook("gfl_exact")
    return mapped(given, noisy(swept(given, values_of(given))))


@pytest.mark.nightly
@each_of("hidden", HIDDEN.values(), ids=HIDDEN)
def test_with_parameters_10_percent_off_the_port_of_a_hidden_block_is_adequate(hidden):
    (fit,) = mapped(hidden.given(), noisy(hidden.device()), only=[hidden.port])
    assert fit.port.name == hidden.port
    assert fit.adequate
    assert fit.chi2_per_dof == fit.chi2 / fit.dof
    assert 8 * 32 - 2 * 16 - 12 < fit.dof < 8 * 32 - 2 * 6
    assert np.array_equal(fit.frequency, FREQUENCY)
    seen = fit.deviation < 0.3
    if seen.any():
        assert farthest(fit, hidden.law(S), seen) < DEVIATIONS


@pytest.mark.nightly
@each_of("hidden", HIDDEN.values(), ids=HIDDEN)
def test_with_known_parameters_the_measured_transfer_follows_the_law_of_the_block(hidden):
    given = hidden.given()
    true = values_of(given)
    known = believed(true, width=0.002)
    (fit,) = port_map(given, VOCABULARY, noisy(hidden.device()), known, [true], only=[hidden.port])
    law = hidden.law(S)
    seen = fit.deviation < 0.1 * np.maximum(np.abs(law), 0.1)
    assert seen.sum() >= 10
    assert farthest(fit, law, seen) < DEVIATIONS


@pytest.mark.nightly
@pytest.mark.parametrize(
    "name", ["control_delay", "pll_prefilter", "decoupling", "ac_voltage_loop"]
)
def test_of_all_ports_that_of_a_gross_effect_comes_first_and_alone(name):
    fits = map_of(name)
    assert fits[0].port.name == HIDDEN[name].port
    assert [fit.adequate for fit in fits] == [True] + [False] * (len(fits) - 1)
    assert fits[1].chi2_per_dof > 3
    per_dof = [fit.chi2_per_dof for fit in fits]
    assert per_dof == pytest.approx(
        sorted(per_dof), rel=1e-5
    )  # exact twins come in the order of the ports


@pytest.mark.slow
def test_what_one_port_can_say_another_that_commutes_with_it_says_as_well():
    fits = {fit.port.name: fit for fit in map_of("control_delay")}
    measured, reference = fits["power.p and power.q"], fits["i_ref.out"]
    assert measured.chi2 == pytest.approx(reference.chi2, rel=1e-2)


@pytest.mark.slow
def test_with_nothing_hidden_a_port_that_replaces_nothing_is_adequate():
    fits = [fit for fit in map_of_nothing() if " in place of " not in fit.port.name]
    assert len(fits) == 18
    for fit in fits:
        assert fit.adequate
        seen = fit.deviation < 0.3
        if seen.any():
            assert farthest(fit, np.zeros(16), seen) < DEVIATIONS


@pytest.mark.slow
def test_with_nothing_hidden_no_port_in_place_of_a_loop_is_adequate():
    assert not any(fit.adequate for fit in map_of_nothing() if " in place of " in fit.port.name)


@pytest.mark.nightly
def test_the_fitted_parameters_explain_the_data_with_the_transfer():
    hidden = HIDDEN["control_delay"]
    fit = map_of("control_delay")[0]
    sweep = noisy(hidden.device())
    response = opened(fit.port, dict(fit.values), sweep).response(1 + fit.transfer)
    sigma = np.stack([one.sigma for one in sweep.points], axis=1)
    assert (np.abs((response - measured(sweep)) / sigma) ** 2).sum() == pytest.approx(
        fit.chi2, rel=1e-9
    )


@pytest.mark.slow
def test_a_scale_of_two_on_sigma_quarters_chi2_and_doubles_the_standard_errors():
    hidden = HIDDEN["control_delay"]
    true = values_of(hidden.given())
    options = {"only": ["plant.u_r"]}
    sharp = believed(true, width=1e-6)  # so that the prior has no say in the matter
    one, two = (
        port_map(
            hidden.given(),
            VOCABULARY,
            noisy(hidden.device()),
            sharp,
            [true],
            scale=scale,
            **options,
        )[0]
        for scale in (1.0, 2.0)
    )
    assert two.chi2 == pytest.approx(one.chi2 / 4, rel=1e-3)
    seen = one.deviation < 0.1
    np.testing.assert_allclose(two.deviation[seen], 2 * one.deviation[seen], rtol=0.02)


@pytest.mark.slow
def test_a_bad_start_beside_a_good_one_does_no_harm_and_names_that_it_lacks_come_from_the_prior():
    hidden = HIDDEN["pll_prefilter"]
    given, sweep = hidden.given(), noisy(hidden.device())
    nominal = off(values_of(given))
    bad = {name: value * 50 for name, value in nominal.items() if name.startswith("current.")}
    (alone,) = port_map(given, VOCABULARY, sweep, believed(nominal), [{}], only=["pll.e_q"])
    (both,) = port_map(given, VOCABULARY, sweep, believed(nominal), [bad, {}], only=["pll.e_q"])
    assert alone.adequate
    assert both.chi2 == pytest.approx(alone.chi2, abs=0.5)


@pytest.mark.slow
def test_one_operating_point_is_enough_to_find_a_delay():
    hidden = HIDDEN["control_delay"]
    sweep = noisy(hidden.device()).only(["p=1,q=0.3"])
    (fit,) = mapped(hidden.given(), sweep, only=["plant.u_r"])
    assert fit.adequate
    assert 8 * 16 - 2 * 16 - 12 < fit.dof < 8 * 16 - 2 * 6


# what cannot be mapped


def test_without_sigma_the_sentence_names_the_operating_point():
    given = textbook("gfl_exact")
    with pytest.raises(IbridError, match=r"needs sigma at operating point p=1,q=0\.3"):
        mapped(given, swept(given, values_of(given)))


def test_points_on_different_grids_are_refused():
    given = textbook("gfl_exact")
    sweep = noisy(swept(given, values_of(given)))
    first, second = sweep.points
    shorter = PointSweep(
        second.op, FREQUENCY[:-1], second.admittance[:-1], sigma=np.asarray(second.sigma)[:-1]
    )
    with pytest.raises(IbridError, match="one frequency grid"):
        mapped(given, replace(sweep, points=(first, shorter)))


@pytest.mark.slow
def test_unknown_names_of_ports_and_parameters_get_the_near_ones():
    given = textbook("gfl_exact")
    true = values_of(given)
    sweep = noisy(swept(given, true))
    with pytest.raises(IbridError, match=r"no port 'pll.e'; did you mean pll.e_q"):
        mapped(given, sweep, only=["pll.e"])
    with pytest.raises(IbridError, match=r"the prior names 'pll.kP', .* did you mean .*pll.kP_pll"):
        port_map(given, VOCABULARY, sweep, {"pll.kP": NominalValue(1.0, 1.0)}, [true])
    with pytest.raises(IbridError, match=r"a start names 'plant.L', .* did you mean"):
        port_map(given, VOCABULARY, sweep, believed(true), [{"plant.L": 0.1}])
