"""The compiled loops against dense linear algebra and difference quotients."""

import numpy as np
import pytest
from collecting import each_of
from fitted import benchmark, drawn, problem_of

import ibrid
from ibrid.fit import kernel
from ibrid.fit.lane_response import plan_elimination
from ibrid.fit.least_squares import Points
from ibrid.fit.problem import Coordinates, Misfit
from ibrid.structure.reading.parameters import Parameter

NAMES = ibrid.textbook_names()
#: cancellation in (f(x+h) - f(x-h))/2h with h = 1e-6 leaves about 1e-10 / 1e-6 of the largest slope
DIFFERENCES = 2e-5
#: a processor takes several numbers of a batch at once, and single ones by other instructions: the
#: values of a model differ in their last digit (2e-16), and the pivots of K magnify that by up to
#: 1e4
VECTORS = 1e-12


def random_system(rng: np.random.Generator, size: int, delays: int = 0):
    """A dense M (size + 2, size + 2), as entries, with delayed signals in the last rows."""
    matrix = rng.normal(size=(size + 2, size + 2)) * 10.0 ** rng.uniform(
        -3, 3, (size + 2, size + 2)
    )
    lags = np.full(size, -1.0)
    if delays:
        lags[-delays:] = rng.uniform(1e-6, 1e-3, delays)
    rows, columns = np.nonzero(matrix)
    return matrix, matrix[rows, columns], rows.astype(np.int64), columns.astype(np.int64), lags


def dense_response(matrix: np.ndarray, lags: np.ndarray, omega: np.ndarray) -> np.ndarray:
    n = len(lags)
    found = []
    for w in omega:
        phi = np.diag(np.where(lags < 0, 1j * w, np.exp(1j * w * np.where(lags < 0, 0, lags))))
        inner = np.linalg.solve(phi - matrix[:n, :n], matrix[:n, n:]) if n else np.zeros((0, 2))
        found.append(matrix[n:, :n] @ inner + matrix[n:, n:])
    return np.array(found)


@pytest.mark.parametrize(
    ("size", "delays"), [(0, 0), (1, 0), (2, 1), (3, 3), (12, 0), (13, 2), (30, 4)]
)
def test_response_equals_a_dense_solve(size, delays):
    rng = np.random.default_rng([1, size])
    omega = 2 * np.pi * np.logspace(-1, 4, 9)
    for _ in range(5):
        matrix, values, rows, columns, lags = random_system(rng, size, delays)
        expected = dense_response(matrix, lags, omega)
        found = kernel.respond(values, rows, columns, lags, omega, size)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


def test_pivoting_copes_with_a_zero_diagonal_in_the_worst_order():
    n = 8  # K = j omega I - M with omega = 0 is a permutation: no pivot lies on the diagonal
    matrix = np.zeros((n + 2, n + 2))
    matrix[:n, :n] = np.roll(np.diag(np.arange(1.0, n + 1)), 3, axis=1)
    matrix[:n, n:] = np.random.default_rng(0).normal(size=(n, 2))
    matrix[n:, :n] = np.random.default_rng(1).normal(size=(2, n))
    rows, columns = np.nonzero(matrix)
    lags, omega = np.full(n, -1.0), np.array([0.0, 1e-12, 3.0])
    wanted = dense_response(matrix, lags, omega)
    found = kernel.respond(matrix[rows, columns], rows, columns, lags, omega, n)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    assert cost_of(matrix[rows, columns], rows, columns, lags, omega, wanted) < 1e-23


def cost_of(values, rows, columns, lags, omega, data) -> float:
    """Squared relative error of a model, of whose frequencies several are taken at once."""
    none, line = np.zeros(0, dtype=np.int64), 1j * omega
    cost, *_ = kernel.normal_equations(
        values[None],
        np.zeros((1, 0)),
        rows,
        columns,
        none,
        none,
        np.full(len(lags), -1, dtype=np.int64),
        lags[None],
        line,
        kernel.excited(None, line),
        data,
        1 / np.abs(data),
        False,
        len(lags),
        0,
        False,
        np.full(1, np.inf),
        False,
        plan_elimination(rows, columns, none, len(lags)),
    )
    return float(cost[0])


def test_pivots_of_very_different_size_lose_no_accuracy():
    matrix = np.array(
        [[1e-14, 1.0, 1.0, 0.0], [1.0, 1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]
    )
    rows, columns = np.nonzero(matrix)
    lags, omega = np.full(2, -1.0), np.array([1e-9])
    wanted = dense_response(matrix, lags, omega)
    found = kernel.respond(matrix[rows, columns], rows, columns, lags, omega, 2)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)
    assert cost_of(matrix[rows, columns], rows, columns, lags, omega, wanted) < 1e-23


@pytest.mark.parametrize("bad", [np.nan, 0.0])
def test_a_singular_or_unreal_model_has_no_response_and_an_infinite_cost(bad):
    # x = bad x + v at omega = 0: with bad = 0 the matrix K is zero
    values = np.array([bad, 1.0, 1.0, 1.0, 1.0])
    rows, columns = np.array([0, 0, 0, 1, 2]), np.array([0, 1, 2, 0, 0])
    lags, omega = np.full(1, -1.0), np.array([0.0])
    found = kernel.respond(values, rows, columns, lags, omega, 1)
    assert not np.isfinite(found).any()
    assert cost_of(values, rows, columns, lags, omega, np.ones((1, 2, 2), complex)) == np.inf


@pytest.mark.slow
@each_of("name", NAMES)
def test_derivatives_of_a_textbook_diagram_equal_central_differences(name):
    problem, _ = problem_of(ibrid.textbook(name), benchmark())
    x = drawn(problem, np.random.default_rng(3))[0]
    step = 1e-6
    for point, slope in enumerate(problem.jacobians(x)):
        for index in range(problem.size):
            ahead, behind = x.copy(), x.copy()
            ahead[index] += step
            behind[index] -= step
            difference = (problem.responses(ahead)[point] - problem.responses(behind)[point]) / (
                2 * step
            )
            scale = max(np.abs(difference).max(), 1e-3 * np.abs(problem.responses(x)[point]).max())
            assert np.abs(slope[..., index] - difference).max() < DIFFERENCES * scale, (
                problem.numbers[index].name
            )


@pytest.mark.parametrize("name", ["gfl_pll_filter", "gfl"])
def test_derivatives_in_paper_mode_equal_central_differences(name):
    problem, _ = problem_of(ibrid.textbook(name), benchmark(), "paper")
    assert (
        sum(one.point is not None for one in problem.numbers) == 6
    )  # E0d, I0d, delta_eq at each of two points
    x = drawn(problem, np.random.default_rng(4))[0]
    equations = problem.normal_equations(x[None], "relative")
    for index in range(problem.size):
        move = 1e-6 * np.eye(problem.size)[index]
        difference = (
            problem.costs((x + move)[None], "relative")
            - problem.costs((x - move)[None], "relative")
        ) / 4e-6
        np.testing.assert_allclose(
            equations.gradient[0, :, index], difference[0], atol=1e-6 * equations.cost.max()
        )


@pytest.mark.slow
@each_of("objective", ["nrmse", "relative", "band", "log"])
@each_of("name", ["gfl_pll_filter_exact", "gfl_delay", "naive"])
def test_normal_equations_equal_the_dense_products(name, objective):
    problem, _ = problem_of(ibrid.textbook(name), benchmark())
    x = drawn(problem, np.random.default_rng(5), 3)
    equations = problem.normal_equations(x, objective, with_slopes=True)
    cost, gradient, hessian = equations.cost, equations.gradient, equations.hessian
    elsewhere = drawn(problem, np.random.default_rng(6), 3)
    projected = problem.projected(elsewhere, objective, equations.slopes)
    np.testing.assert_allclose(problem.costs(x, objective), cost, rtol=1e-12)
    for start in range(len(x)):
        responses, jacobians = problem.responses(x[start]), problem.jacobians(x[start])
        others, product = problem.responses(elsewhere[start]), np.zeros(problem.size)
        for m, weights in enumerate(problem.residuals(objective)):
            data = problem.points[m].admittance
            if weights.logarithmic:
                r = weights.weight * np.log(responses[m] / data)
                other = weights.weight * np.log(others[m] / data)
                j = (weights.weight / responses[m])[..., None] * jacobians[m]
            else:
                r = weights.weight * (responses[m] - data)
                other = weights.weight * (others[m] - data)
                j = weights.weight[..., None] * jacobians[m]
            r = np.concatenate([r.real.ravel(), r.imag.ravel()])
            other = np.concatenate([other.real.ravel(), other.imag.ravel()])
            j = np.concatenate([j.real.reshape(-1, problem.size), j.imag.reshape(-1, problem.size)])
            product += j.T @ other
            scale = np.linalg.norm(j) ** 2
            np.testing.assert_allclose(cost[start, m], r @ r, rtol=1e-9)
            np.testing.assert_allclose(
                gradient[start, m], j.T @ r, atol=1e-9 * np.linalg.norm(j) * np.linalg.norm(r)
            )
            np.testing.assert_allclose(hessian[start, m], j.T @ j, atol=1e-9 * scale)
        np.testing.assert_allclose(
            projected[start], product, rtol=1e-9, atol=1e-9 * np.abs(product).max()
        )


def test_a_batch_gives_what_its_members_give_alone():
    problem, _ = problem_of(ibrid.textbook("gfl_delay"), benchmark())
    x = drawn(problem, np.random.default_rng(6), 5)
    whole = problem.normal_equations(x, "log")
    for index in range(len(x)):
        single = problem.normal_equations(x[index : index + 1], "log")
        for part, alone in zip(whole.sums, single.sums, strict=True):
            np.testing.assert_allclose(
                part[index], alone[0], rtol=0, atol=VECTORS * np.abs(alone[0]).max()
            )


def test_a_cost_beyond_that_of_the_point_near_by_is_infinite_and_the_others_stay_as_they_are():
    problem, _ = problem_of(ibrid.textbook("gfl_delay"), benchmark())
    x = drawn(problem, np.random.default_rng(8), 4)
    misfit = Misfit(problem, "nrmse")
    free = misfit.at(x)
    near = Points(x, free.cost * np.array([2.0, 0.5, 1.01, 0.99]))
    held = misfit.at(x, near)
    assert np.array_equal(np.isinf(held.cost), [False, True, False, True])
    for part, own in zip(
        (held.cost, *misfit.normal(held)), (free.cost, *misfit.normal(free)), strict=True
    ):
        np.testing.assert_allclose(
            part[[0, 2]], own[[0, 2]], rtol=0, atol=VECTORS * np.abs(own[[0, 2]]).max()
        )


def test_a_start_without_an_operating_point_costs_infinity_and_leaves_the_others_alone():
    problem, _ = problem_of(ibrid.textbook("gfl_exact"), benchmark())
    x = drawn(problem, np.random.default_rng(7), 2, decades=0.1)
    names = [one.name for one in problem.numbers]
    x[0, names.index("plant.L_g")] = np.log(0.99)  # p = 1 does not pass through L_g = 0.99
    equations = problem.normal_equations(x, "nrmse", with_slopes=True)
    assert np.isinf(equations.cost[0]).all()
    assert np.isfinite(equations.cost[1]).all()
    assert np.isfinite(equations.gradient[1]).all()
    assert np.isfinite(equations.hessian[1]).all()
    assert np.isnan(problem.projected(x, "nrmse", equations.slopes)[0]).all()


@pytest.mark.parametrize(
    ("low", "high"), [(1e-5, 1.0), (-1.0, 1.0), (-1e4, 1e4), (-50.0, 0.0), (0.0, 5.0)]
)
def test_coordinates_go_there_and_back_inside_the_box(low, high):
    box = Parameter("a", low, high, 0.5 * (low + high), "", "", (("m", "a"),))
    coordinates = Coordinates([box])
    theta = np.linspace(low, high, 41)[:, None]
    x = coordinates.to_x(theta)
    np.testing.assert_allclose(coordinates.to_theta(x), theta, rtol=1e-12, atol=1e-12)
    assert (coordinates.to_theta(x + 3.0) <= high).all()
    assert (coordinates.to_theta(x - 3.0) >= low).all()
    inside = theta[5:-5]
    difference = (coordinates.to_theta(coordinates.to_x(inside) + 1e-6) - inside) / 1e-6
    np.testing.assert_allclose(coordinates.slope(inside), difference, rtol=1e-4)
