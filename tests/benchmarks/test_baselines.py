"""Baselines of the search: each finds a case with a closed form, and the table shows all of them
with their errors.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ibrid_bench.baselines.__main__ import main
from ibrid_bench.baselines.answer import Answer, scored
from ibrid_bench.baselines.between import nearest, weights_between
from ibrid_bench.baselines.case import GRID, INVERTERS, Case, cases_of
from ibrid_bench.baselines.methods import METHODS, placed, row_key
from ibrid_bench.baselines.recovered import recovered
from ibrid_bench.baselines.series_filter import (
    SeriesFilter,
    impedance_terms,
    rotating,
    series_filter,
)
from ibrid_bench.baselines.sparse import sparse_regression
from ibrid_bench.baselines.sparse_model import sparse_model
from ibrid_bench.baselines.tables import NOT_YET, page
from ibrid_bench.baselines.terms import control_terms
from ibrid_bench.baselines.vector_fit import vector_fit
from ibrid_bench.ledger import Ledger
from ibrid_bench.search.hidden import FREQUENCY
from ibrid_bench.search.inverters import inverter, plant_of
from ibrid_bench.search.trials import BUDGETS

import ibrid
from ibrid.errors import IbridError
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.plants.sweeping import state_space

OMEGA_0 = 2 * np.pi * 60
HERE, THERE = OperatingPoint("here", 1.0, 0.3), OperatingPoint("there", 1.0, -0.3)
HALF = OperatingPoint("half", 0.5, 0.0)
POLES = np.array([-30.0, -200 + 900j, -100 + 9000j])


def rational(frequency: np.ndarray) -> np.ndarray:
    """A 2x2 rational function of order five."""
    rng = np.random.default_rng(3)
    s = 2j * np.pi * frequency[:, None, None]
    value = 0.1 * rng.standard_normal((2, 2)) + np.zeros_like(s)
    for pole in POLES:
        residue = abs(pole) * (
            rng.standard_normal((2, 2)) + 1j * (pole.imag != 0) * rng.standard_normal((2, 2))
        )
        value = (
            value
            + residue / (s - pole)
            + (np.conj(residue) / (s - np.conj(pole)) if pole.imag else 0)
        )
    return value


def swept(responses, ops=(HERE, THERE), frequency=FREQUENCY) -> Sweep:
    """A sweep of given responses (op, frequency) -> (K, 2, 2)."""
    return Sweep(tuple(PointSweep(op, frequency, responses(op, frequency)) for op in ops))


def relative(value: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(value - true) / np.linalg.norm(true))


def test_vector_fitting_finds_a_rational_function_and_its_order():
    pytest.importorskip("skrf", reason="vector fitting needs scikit-rf")
    model = vector_fit(PointSweep(HERE, FREQUENCY, rational(FREQUENCY)))
    assert model.order == 5
    assert model.parameters == 5 + 4 * 5 + 4
    assert np.sort_complex(model.poles) == pytest.approx(np.sort_complex(POLES), rel=1e-6)
    between = np.geomspace(6, 4000, 50)
    assert (
        relative(model.admittance(between), rational(between)) < 1e-8
    )  # rounding, times the condition of the basis


def test_vector_fitting_does_not_take_noise_for_poles():
    pytest.importorskip("skrf", reason="vector fitting needs scikit-rf")
    data = add_noise(
        swept(lambda op, frequency: rational(frequency)), 60.0, rng=np.random.default_rng(1)
    )
    model = vector_fit(data.points[0])
    assert model.order == 5
    assert relative(model.admittance(FREQUENCY), rational(FREQUENCY)) < 1e-3  # the noise


def test_vector_fitting_asks_for_enough_frequencies():
    point = PointSweep(HERE, FREQUENCY[:1], rational(FREQUENCY[:1]))
    with pytest.raises(IbridError, match="at least 2 frequencies"):
        vector_fit(point)


def series_circuit(op: OperatingPoint, frequency: np.ndarray) -> np.ndarray:
    """R_g, L_g and C_F in series: three terms of the library of twenty; current out."""
    inductor = rotating(frequency, OMEGA_0)
    return -np.linalg.inv(0.01 * np.eye(2) + 0.15 * inductor + np.linalg.inv(0.066 * inductor))


@pytest.mark.parametrize(("decibel", "within"), [(None, 1e-6), (60.0, 0.01), (40.0, 0.05)])
def test_sparse_regression_finds_the_three_terms_of_a_series_circuit_among_twenty(decibel, within):
    assert len(impedance_terms(FREQUENCY, OMEGA_0)) == 20
    data = swept(series_circuit)
    if decibel is not None:
        data = add_noise(data, decibel, rng=np.random.default_rng(0))
    found = series_filter(data)
    assert found.L_g == pytest.approx(0.15, rel=within)
    assert pytest.approx(0.066, rel=within) == found.C_F
    if decibel is None:
        assert found.R_g == pytest.approx(
            0.01, rel=1e-4
        )  # the capacitor of the library has a loss of 1e-6


def test_sparse_regression_leaves_out_what_the_data_do_not_need():
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((200, 20)) + 2.0 * rng.standard_normal((200, 1))  # correlated
    target = columns[:, [2, 7, 11]] @ [1.0, -0.3, 4.0]
    found = sparse_regression(columns, target, known=False)
    assert found.chosen == (2, 7, 11)
    assert found.coefficients == pytest.approx([1.0, -0.3, 4.0])
    noisy = sparse_regression(
        columns / 0.05, (target + 0.05 * rng.standard_normal(200)) / 0.05, known=True
    )
    assert noisy.chosen == (2, 7, 11)


def test_a_regression_says_what_is_wrong_with_its_library():
    with pytest.raises(IbridError, match="same order"):
        sparse_regression(np.ones((4, 2)), np.ones(3), known=False)
    with pytest.raises(IbridError, match="term 1 is zero"):
        sparse_regression(np.array([[1.0, 0.0], [2.0, 0.0]]), np.ones(2), known=False)


def test_a_series_resistance_alone_is_no_filter():
    data = swept(
        lambda op, frequency: -np.linalg.inv(0.3 * np.eye(2) + 0.2 * rotating(frequency, OMEGA_0))
    )
    assert series_filter(data) == SeriesFilter()
    assert series_filter(data).found == {}


def test_going_through_a_filter_and_back_changes_nothing():
    filter_ = SeriesFilter(0.01, 0.15, 0.066)
    y = rational(FREQUENCY)
    behind = filter_.inwards(FREQUENCY, OMEGA_0, y)
    assert relative(filter_.outwards(FREQUENCY, OMEGA_0, behind), y) < 1e-12
    assert relative(SeriesFilter().inwards(FREQUENCY, OMEGA_0, y), -y) < 1e-12


def test_the_terminals_at_rest_follow_from_power_alone():
    e, i_g, i_ti = SeriesFilter().at_rest(HERE)
    assert e == pytest.approx([1.0, 0.0])
    assert i_g == pytest.approx([1.0, -0.3])  # q = e' J i
    assert i_ti == pytest.approx(i_g)


def test_the_term_of_power_control_is_the_slope_of_p_and_minus_q_with_the_voltage():
    i = np.array([1.0, -0.3])
    quarter_turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    slope = np.array([i, quarter_turn @ i])  # of p = e' i and q = e' J i
    terms = control_terms(FREQUENCY, OMEGA_0, HERE, SeriesFilter())
    assert terms["S 1"][0] == pytest.approx(np.diag([1.0, -1.0]) @ slope)
    assert terms["P 1"][0] == pytest.approx(np.outer(quarter_turn @ i, [0.0, 1.0]))


def test_a_sum_of_library_terms_is_found_and_carries_over_to_another_operating_point():
    parts = {"I lag 316 Hz": 0.8, "S lag 10 Hz": -0.5, "P lag 31.6 Hz": 0.3}

    def response(op: OperatingPoint, frequency: np.ndarray) -> np.ndarray:
        terms = control_terms(frequency, OMEGA_0, op, SeriesFilter())
        return -np.sum([value * terms[name] for name, value in parts.items()], axis=0)

    model = sparse_model(swept(response), SeriesFilter())
    assert model.coefficients == pytest.approx(parts)
    assert relative(model.admittance(HALF, FREQUENCY), response(HALF, FREQUENCY)) < 1e-9


def test_between_points_is_exact_for_polynomials_of_the_degree_that_the_points_decide():
    at_nine = [(1 + one.p - 2 * one.p**2) * (3 - one.q + one.q**2) for one in GRID]
    assert weights_between(GRID, HALF) @ at_nine == pytest.approx((1 + 0.5 - 2 * 0.25) * 3)
    assert weights_between((HERE, THERE), HALF) == pytest.approx(
        [0.5, 0.5]
    )  # one p alone says nothing about p


def test_equally_near_points_are_all_near():
    assert nearest((HERE, THERE), HALF) == (0, 1)
    assert nearest((HERE, THERE), OperatingPoint("up", 0.9, 0.1)) == (0,)


def test_errors_are_those_of_data_truth_and_the_held_out_point():
    truth = swept(lambda op, frequency: rational(frequency))
    data = swept(lambda op, frequency: 2 * rational(frequency))
    y = rational(FREQUENCY)
    answer = Answer([2 * y, 2 * y], [y, 0.5 * y], 7, "-", None, "nothing")
    row = scored(answer, data, truth, truth.points[0])
    assert (row["fitted"], row["true"], row["held_out"]) == pytest.approx((0.0, 1.0, 0.25))


def test_the_held_out_point_is_the_truth_of_the_reference_inverter():
    for noise in (None, 40.0):
        case = Case("paper_like", noise)
        plant = plant_of("paper_like")
        assert plant is not None
        assert (case.held_out.op.p, case.held_out.op.q) == (0.5, 0.0)
        true = state_space(plant, case.held_out.op).admittance(FREQUENCY)
        assert relative(case.held_out.admittance, true) < 1e-12
    data, truth = Case("paper_like", 40.0).grid()
    assert 0.005 < relative(data.points[0].admittance, truth.points[0].admittance) < 0.02


@pytest.mark.parametrize("name", INVERTERS)
def test_the_wrong_textbook_diagram_lacks_the_pll_filter_alone(name):
    case = Case(name)
    truth, wrong = case.truth, case.wrong()
    assert {one.name for one in truth.instances} - {one.name for one in wrong.instances} == {
        "pll_filter"
    }
    assert {one.name for one in wrong.instances} <= {one.name for one in truth.instances}


def test_parameters_count_as_recovered_within_five_percent_whatever_the_modules_are_called():
    case = Case("paper_like")
    record = ibrid.evaluate(case.truth, case.hidden.sweep)
    name = next(iter(record.parameters))

    def of(program: str, **changes: float) -> set[str]:
        at = {**case.values, **{key.replace("__", "."): value for key, value in changes.items()}}
        return set(
            recovered(
                replace(record, program=program, parameters={name: at}), case.truth, case.values
            )
        )

    assert of(record.program) == set(case.values)
    assert set(case.values) - of(record.program, plant__L_g=0.15 * 1.06, power__kP=0.02 * 1.04) == {
        "plant.L_g"
    }
    renamed = record.program.replace('"pll"', '"lock"').replace('"pll.', '"lock.')
    moved = {f"lock__{key}": case.values[f"pll.{key}"] for key in ("kP_pll", "kI_pll")}
    assert of(renamed, **moved) == set(case.values)
    own_gains = renamed.replace('kP="power.kP"', 'kP="of_p"', 1)
    # with two gains the loops are two blocks where the truth has one: nothing to compare them with
    assert set(case.values) - of(own_gains, **moved, of_p=0.05) == {"power.kP", "power.kI"}


@dataclass(frozen=True)
class Found:
    """An answer of a search that was never made."""

    answer_program: str
    best: Any
    evaluations: int = 40
    finished: bool = True
    seconds: float = 3.0
    selection: Any = field(default_factory=dict)
    trajectory: tuple = ((0, 0.9, 0.9), (1, 1e-9, 1e-9))


def searching(seen: list):
    """A search that finds the truth at once."""

    def search(sweep: Sweep, folder: Path, **options: Any) -> Found:
        seen.append((sweep, options))
        program = inverter("paper_like").program
        return Found(program, ibrid.evaluate(ibrid.parse_program(program), sweep))

    return search


def quick(folder: Path, *more: str) -> list[str]:
    methods = [
        part for name in ("sparse-terminals", "textbook", "search") for part in ("--method", name)
    ]
    places = ["--out", str(folder / "out"), "--page", str(folder / "page.md")]
    return ["--inverter", "paper_like", *methods, *places, *more]


def test_the_page_has_every_row_of_every_case_and_measures_nothing_twice(tmp_path, capsys):
    seen: list = []
    assert main(quick(tmp_path), search=searching(seen)) == 0
    shown = capsys.readouterr().out
    assert shown.count(METHODS["search"].title) == 2  # clean and 40 dB
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    for method in METHODS.values():
        assert text.count(f"| {method.title} |") == 2 * len(INVERTERS)
    assert text.count(NOT_YET) == 2 * len(INVERTERS) * len(METHODS) - 2 * 3
    assert [len(sweep.points) for sweep, _ in seen] == [2, 2]  # the held-out point is never seen
    assert seen[0][1]["budget"] == 1000
    row = Ledger(tmp_path / "out").rows[row_key(Case("paper_like"), "search", 1000)]
    assert row["held_out"] < 1e-9
    assert row["recovered"] == 8  # of 13; the other five scale together
    assert row["seconds"] == 3.0
    assert main(quick(tmp_path), search=searching(seen)) == 0
    assert len(seen) == 2
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == text


def test_the_page_in_the_docs_is_that_of_the_shipped_results():
    docs = Path(__file__).resolve().parents[2] / "docs"
    cases, rows = cases_of(INVERTERS), Ledger(docs / "measured" / "baselines").rows
    assert (docs / "baselines.md").read_text(encoding="utf-8") == page(
        cases, placed(cases, rows, BUDGETS["inverters"])
    )


def test_another_budget_is_another_search(tmp_path):
    case = Case("paper_like")
    assert row_key(case, "search", 500) != row_key(case, "search", 100)
    assert row_key(case, "textbook", 500) == row_key(case, "textbook", 100)


def test_a_method_without_an_answer_says_so_and_the_others_go_on(tmp_path, capsys):
    out = ["--out", str(tmp_path / "out"), "--page", str(tmp_path / "page.md")]
    methods = ["--method", "vector-fitting-nine", "--method", "sparse-terminals"]
    assert (
        main(["--inverter", "random_04", *methods, *out]) == 1
    )  # unstable at half power: no sweep there
    shown = capsys.readouterr().out
    assert "must be stable to be swept" in shown
    assert shown.count("a sum of lags and resonances") == 2


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (["--method", "vector-fiting"], "there is no method called vector-fiting"),
        (["--inverter", "paper_lik"], "did you mean paper_like?"),
        (["--inverter", "random_01"], "a filter before its PLL"),
        (["--page", "nowhere/page.md"], "there is no folder"),
    ],
)
def test_wrong_options_are_one_sentence(tmp_path, capsys, wrong, sentence):
    assert main(["--out", str(tmp_path / "out"), *wrong]) == 2
    shown = capsys.readouterr()
    assert sentence in shown.err
    assert shown.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
