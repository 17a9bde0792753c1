"""Descents against functions whose minima are known in closed form."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ibrid.fit.least_squares import Descent, Ending, Points, carried

BOX = 5.0


class CurvedValley:
    """Rosenbrock's function, Computer J. 3, 1960: r = (b (x_2 - x_1^2), 1 - x_1), least at (1, 1).

    The larger b is, the narrower is the valley x_2 = x_1^2, whose floor hardly falls.
    """

    def __init__(self, b: float) -> None:
        self.b = b
        self.box = np.full(2, -BOX), np.full(2, BOX)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        return np.stack([self.b * (x[:, 1] - x[:, 0] ** 2), 1.0 - x[:, 0]], axis=1)

    def slopes(self, x: np.ndarray) -> np.ndarray:
        ones, none = np.ones(len(x)), np.zeros(len(x))
        rows = [[-2.0 * self.b * x[:, 0], self.b * ones], [-ones, none]]
        return np.moveaxis(np.array(rows), 2, 0)

    def at(self, x: np.ndarray, near: Points | None = None) -> Points:
        r = self.residuals(x)
        return Points(x, (r**2).sum(axis=1), carried(zip(r, self.slopes(x), strict=True)))

    def normal(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        pairs = points.carried[0]
        return np.array([j.T @ r for r, j in pairs]), np.array([j.T @ j for _, j in pairs])

    def projected(self, x: np.ndarray, points: Points) -> np.ndarray:
        slopes = (j for _, j in points.carried[0])
        return np.array([j.T @ r for r, j in zip(self.residuals(x), slopes, strict=True)])


def steps_needed(descent: Descent, model: CurvedValley, start: np.ndarray) -> int:
    """Number of steps to a cost that is exact, 1000 at most."""
    batch = descent.begin(model, start[None])
    for number in range(1000):
        if batch.ended[0] == Ending.EXACT:
            return number
        batch = descent.go(model, batch, 1)
    return 1000


coordinates = st.floats(-2.0, 2.0)


@settings(max_examples=30, deadline=None)
@given(coordinates, coordinates, st.sampled_from([1.0, 10.0, 100.0]))
def test_a_descent_ends_at_the_minimum_of_a_curved_valley(first, second, b):
    model = CurvedValley(b)
    batch = Descent(acceleration=0.75).begin(model, np.array([[first, second]]))
    end = Descent(acceleration=0.75).go(model, batch, 1000)
    assert end.ended[0] == Ending.EXACT
    np.testing.assert_allclose(end.x[0], 1.0, atol=1e-5)


def test_geodesic_acceleration_takes_a_third_of_the_steps_along_a_curved_valley():
    model = CurvedValley(1000.0)
    starts = [np.array([-1.2, 1.0]), np.array([-2.0, 4.0]), np.array([2.0, 4.0])]
    straight = sum(steps_needed(Descent(), model, start) for start in starts)
    bent = sum(steps_needed(Descent(acceleration=0.75), model, start) for start in starts)
    assert 3 * bent < straight


def test_starts_of_a_batch_descend_as_they_do_alone():
    model, descent = CurvedValley(10.0), Descent(acceleration=0.75)
    starts = np.array([[-1.2, 1.0], [2.0, -1.0], [0.5, 0.5]])
    together = descent.go(model, descent.begin(model, starts), 20)
    for index, start in enumerate(starts):
        alone = descent.go(model, descent.begin(model, start[None]), 20)
        np.testing.assert_allclose(together.x[index], alone.x[0], rtol=1e-12)


def test_a_minimum_beyond_a_bound_is_looked_for_along_the_bound():
    model = CurvedValley(10.0)
    model.box = np.array([-5.0, -5.0]), np.array([0.5, 5.0])
    end = Descent(acceleration=0.75).go(
        model, Descent(acceleration=0.75).begin(model, np.array([[-1.0, 1.0]])), 500
    )
    np.testing.assert_allclose(end.x[0], [0.5, 0.25], atol=1e-6)
