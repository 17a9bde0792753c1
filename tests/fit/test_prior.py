"""Nominal values as a prior: on the scale of ratios for positive ones, also where the sign may
change.
"""

import re

import numpy as np
import pytest
from fitted import benchmark

from ibrid.assembly.symbolic import symbolic_model
from ibrid.errors import IbridError
from ibrid.fit.problem import Misfit, Problem
from ibrid.gap.refitting.prior import (
    RATIO_LIMIT,
    NominalValue,
    ParameterPrior,
    build_prior,
    read_values,
)
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagrams.library import textbook, textbook_text
from ibrid.structure.diagrams.program import parse_program
from ibrid.structure.reading.parameters import Parameter, parameter_table
from ibrid.structure.reading.wiring import wire


def parameter(low: float, high: float) -> Parameter:
    wiring = wire(textbook("gfl"), VOCABULARY)
    (one,) = parameter_table(wiring, "exact").free[:1]
    return type(one)(**{**vars(one), "low": low, "high": high})


def deviations(low: float, high: float, belief: NominalValue, *values: float) -> list[float]:
    one = parameter(low, high)
    beliefs = ParameterPrior([one], {one.name: belief})
    return [float(beliefs.deviations(np.array([value]))[0]) for value in values]


def test_a_factor_of_one_tolerance_is_one_standard_deviation_in_a_positive_box():
    assert deviations(1e-3, 1e3, NominalValue(2.0, np.log(2)), 1.0, 2.0, 4.0) == pytest.approx(
        [-1.0, 0.0, 1.0]
    )


def test_a_positive_gain_that_may_change_its_sign_is_held_to_ratios_too():
    found = deviations(-100.0, 100.0, NominalValue(2.0, np.log(2)), 1.0, 2.0, 4.0)
    assert found == pytest.approx([-1.0, 0.0, 1.0], abs=0.01)


def test_zero_and_the_other_sign_are_far_off_but_finite():
    zero, other = deviations(-100.0, 100.0, NominalValue(2.0, np.log(2)), 0.0, -2.0)
    assert zero == pytest.approx(-np.arcsinh(1 / RATIO_LIMIT) / np.log(2))
    assert other == pytest.approx(2 * zero)


def test_a_nominal_value_of_zero_has_an_absolute_tolerance():
    assert deviations(-100.0, 100.0, NominalValue(0.0, 0.25), -0.5, 0.0, 0.25) == pytest.approx(
        [-2.0, 0.0, 1.0]
    )


def test_what_went_far_from_its_nominal_value_is_put_back_and_nothing_else():
    one = parameter(1e-3, 1e3)
    beliefs = ParameterPrior([one, one], dict.fromkeys([one.name], NominalValue(2.0, np.log(2))))
    theta = np.array([2.0 * 2**-3.1, 2.0 * 2**2.9])
    back = beliefs.coordinates.to_theta(beliefs.reset_implausible(beliefs.coordinates.to_x(theta)))
    assert back == pytest.approx([2.0, theta[1]])


def believed(program: str, values) -> dict[str, NominalValue]:
    wiring = wire(parse_program(program), VOCABULARY)
    return build_prior(values, wiring, parameter_table(wiring, "exact"))


#: Its loops of p and q share "power.kP".
SHARED = textbook_text("gfl")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (
            {"plant.L_F": 1e9},
            "plant.L_F must lie in the box of the parameter, 0.0001 to 1 pu, found 1e+09",
        ),
        ({"plant.L_F": {"value": 0.9e-5}}, "0.0001 to 1 pu, found 9e-06"),
        ({"pll.kP_pll": 1e12}, "pll.kP_pll must lie in the box"),
    ],
)
def test_a_nominal_value_far_outside_its_box_is_refused_with_name_value_and_box(values, said):
    with pytest.raises(IbridError, match=re.escape(said)):
        believed(textbook_text("gfl"), values)


def test_the_box_is_that_of_the_program_and_its_ends_belong_to_it():
    narrowed = textbook_text("gfl").replace('"LCL", "plant"', '"LCL", "plant", L_F=(0.1, 0.2)')
    assert narrowed != textbook_text("gfl")
    assert believed(narrowed, {"plant.L_F": 0.2 * (1 + 1e-12)})[
        "plant.L_F"
    ].nominal == pytest.approx(0.2)
    with pytest.raises(IbridError, match=r"0\.1 to 0\.2 pu, found 2\.5"):
        believed(narrowed, {"plant.L_F": 2.5})


def test_a_nominal_value_not_far_outside_its_box_is_a_wrong_belief_and_no_error():
    assert believed(textbook_text("gfl"), {"plant.L_F": 1.4})["plant.L_F"].nominal == 1.4


def test_two_nominal_values_of_a_shared_parameter_must_agree():
    with pytest.raises(
        IbridError,
        match=r"p_loop\.kP and q_loop\.kP are one parameter of the program, power\.kP.*0\.5 and 2;",
    ):
        believed(SHARED, {"p_loop.kP": 0.5, "q_loop.kP": 2.0})
    with pytest.raises(
        IbridError, match=r"0\.5 with a tolerance of 0\.1 and 0\.5 with a tolerance of 0\.2"
    ):
        believed(
            SHARED,
            {
                "p_loop.kP": {"value": 0.5, "tolerance": 0.1},
                "power.kP": {"value": 0.5, "tolerance": 0.2},
            },
        )


def test_equal_values_of_a_shared_parameter_are_one_and_a_tolerance_counts_wherever_it_stands():
    assert believed(SHARED, {"p_loop.kP": 0.5, "q_loop.kP": 0.5}) == believed(
        SHARED, {"power.kP": 0.5}
    )
    exact = {"value": 0.5, "tolerance": 0.1}
    for values in ({"p_loop.kP": exact, "q_loop.kP": 0.5}, {"p_loop.kP": 0.5, "q_loop.kP": exact}):
        assert believed(SHARED, values) == {"power.kP": NominalValue(0.5, 0.1)}


@pytest.mark.parametrize("content", ["[" * 200_000, '{"a":' * 200_000, "[1, 2", "\x00", "[0.15]"])
def test_a_file_of_nominal_values_that_holds_something_else_is_a_sentence(content, tmp_path):
    path = tmp_path / "nominal.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(IbridError, match=r"the nominal values .*nominal\.json") as caught:
        read_values(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("content", "word"),
    [("[0.15]", "a list"), ("null", "null"), ("true", "true or false"), ('"a"', "text")],
)
def test_what_stands_for_nominal_values_is_said_in_words_of_json(content: str, word: str, tmp_path):
    path = tmp_path / "nominal.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(IbridError, match=f"found {word}$"):
        read_values(path)


def test_slopes_are_those_of_finite_differences_also_across_the_sign():
    one = parameter(-100.0, 100.0)
    beliefs = ParameterPrior([one], {one.name: NominalValue(0.7, 0.3)})
    for value in (-1.0, -0.01, 0.0, 0.02, 0.7, 5.0):
        step = 1e-6
        ahead, behind = (beliefs.deviations(np.array([value + sign * step]))[0] for sign in (1, -1))
        assert beliefs.slope(np.array([value]))[0] == pytest.approx(
            (ahead - behind) / (2 * step), rel=1e-5
        )


def test_the_penalty_has_the_gradient_of_finite_differences():
    sweep = add_noise(benchmark(), 60, rng=np.random.default_rng(0))
    wiring = wire(textbook("gfl"), VOCABULARY)
    model = symbolic_model(
        wiring, equilibrium="exact", power_node=sweep.power_node, omega_0=sweep.omega_0
    )
    problem = Problem(model, sweep.points)
    names = [one.name for one in problem.numbers]
    table = parameter_table(wiring, "exact")
    beliefs = ParameterPrior(
        model.parameters, build_prior({names[0]: 0.2, names[-1]: 3.0}, wiring, table)
    )
    penalised = Misfit(problem, "chi2", beliefs)
    x = beliefs.start({}) + 0.1

    def cost(at: np.ndarray) -> float:
        return float(penalised.parts(at[None])[0][0, -1])

    gradient = penalised.parts(x[None])[1][0, -1]
    numeric = [(cost(x + step) - cost(x - step)) / 2e-6 for step in 1e-6 * np.eye(len(x))]
    assert 2 * gradient == pytest.approx(numeric, rel=1e-5, abs=1e-8)
    assert np.count_nonzero(gradient) == 2
