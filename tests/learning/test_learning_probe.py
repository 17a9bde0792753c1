"""The probe tells the weights after an update from those before it, by noise that it measures
itself.
"""

import numpy as np
import pytest
from ibrid_policy.learning.probe import probe

RNG = np.random.default_rng(7)
BEFORE = -RNG.exponential(1.0, 200)
AFTER = BEFORE + 3e-4 * RNG.standard_normal(200)


def test_trained_weights_have_the_whole_update_and_those_before_none_of_it():
    found = probe(AFTER, BEFORE, AFTER)
    assert (found.drift, found.share) == (0.0, pytest.approx(1.0))
    assert found.told
    assert not found.other
    found = probe(BEFORE, BEFORE, AFTER)
    assert found.share == pytest.approx(0.0)
    assert found.drift == pytest.approx(np.abs(AFTER - BEFORE).mean())
    assert found.other


def test_weights_that_are_an_update_ahead_are_others_too():
    assert probe(AFTER + (AFTER - BEFORE), BEFORE, AFTER).other


def test_the_share_is_the_slope_through_the_origin_and_its_error_that_of_the_regression():
    served = BEFORE + 0.8 * (AFTER - BEFORE) + 1e-5 * RNG.standard_normal(200)
    found = probe(served, BEFORE, AFTER)
    change, seen = AFTER - BEFORE, served - BEFORE
    slope, left, _, _ = np.linalg.lstsq(change[:, None], seen, rcond=None)
    assert found.share == pytest.approx(slope[0])
    expected = np.sqrt((left[0] / 199 + 1e-12) / (change @ change))  # 1e-6 is what rounding leaves
    assert found.error == pytest.approx(expected)


def test_noise_of_serving_larger_than_the_update_leaves_it_untold_rather_than_wrong():
    told = [probe(AFTER + 0.03 * RNG.standard_normal(200), BEFORE, AFTER).told for _ in range(200)]
    assert np.mean(told) < 0.02


@pytest.mark.parametrize("where", [0.0, 1.0])
def test_noise_of_serving_smaller_than_the_update_is_seen_through(where):
    for _ in range(50):
        served = BEFORE + where * (AFTER - BEFORE) + 1e-4 * RNG.standard_normal(200)
        assert probe(served, BEFORE, AFTER).other == (where == 0.0)


def test_an_update_that_moves_nothing_says_nothing():
    found = probe(BEFORE, BEFORE, BEFORE)
    assert found.share is None
    assert not found.told
    assert not found.other
