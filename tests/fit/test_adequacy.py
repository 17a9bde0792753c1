"""When a model is adequate: by significance, and by the size of what is left."""

import numpy as np
from scipy.stats import chi2, f

from ibrid.fit.adequacy import LEAST_P, NEGLIGIBLE, is_adequate, p_value, share_explained


def test_few_numbers_are_judged_by_their_significance() -> None:
    edge = chi2.isf(LEAST_P, 20)
    assert is_adequate(0.99 * edge, 20)
    assert not is_adequate(1.01 * edge, 20)


def test_ten_thousand_numbers_are_judged_by_the_size_of_what_is_left() -> None:
    assert p_value(1.046 * 9646, 9646) < LEAST_P  # significant, and 2 % of the error
    assert is_adequate(1.046 * 9646, 9646)
    assert not is_adequate((1 + 1.5 * NEGLIGIBLE) * 9646, 9646)


def test_a_noise_that_was_estimated_allows_what_its_estimate_does() -> None:
    ratio = f.isf(LEAST_P, 50, 10)
    assert is_adequate(0.99 * ratio * 50, 50, told_by=10)
    assert not is_adequate(1.01 * ratio * 50, 50, told_by=10)


def test_of_the_squared_misfit_beyond_noise_a_change_explains_a_part() -> None:
    np.testing.assert_allclose(share_explained(1100.0, 100.0, 100.0), 1.0)
    np.testing.assert_allclose(share_explained(1100.0, 600.0, 100.0), 0.5)
    assert share_explained(90.0, 80.0, 100.0) == 0.0
