"""By what candidates rank: laws of the criterion, and the noise floor against noise that was really
drawn.
"""

from dataclasses import replace
from math import log

import numpy as np
import pytest
from ibrid_search.screening.plausibility import PlausibilityIssues
from ibrid_search.screening.selection_criterion import (
    SelectionCriterion,
    build_criterion,
    estimate_noise_floor,
)
from ibrid_search.screening.settings import SCREENING
from ibrid_search.settings import SearchSettings
from scripted_search import study

from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep
from ibrid.study import Study

CLEAN = study().sweep
SETTINGS = SearchSettings(parsimony=0.1, layer=2.0, bound=0.5, residual=0.7)


def noisy(decibel: float, seed: int = 0, **options) -> Sweep:
    return add_noise(CLEAN, decibel, rng=np.random.default_rng(seed), **options)


def record_of_the_truth(sweep: Sweep) -> Record:
    """A record that holds the errors of the clean response against noisy data."""
    squares, errors = [], []
    for noisy, clean in zip(sweep.points, CLEAN.points, strict=True):
        difference = clean.admittance - noisy.admittance
        errors.append(np.linalg.norm(difference) / np.linalg.norm(noisy.admittance))
        squares += list((np.abs(difference / noisy.sigma) ** 2 / 2).ravel())
    return Record("ok", nrmse=float(np.mean(errors)), over_noise=float(np.sqrt(np.mean(squares))))


# the noise floor


@pytest.mark.parametrize("decibel", [60, 40])
def test_the_floor_is_what_noise_leaves_of_the_truth(decibel):
    floor = estimate_noise_floor(noisy(decibel))
    assert floor.level == pytest.approx(10 ** (-decibel / 20), rel=0.02)
    errors = [floor.error_of(record_of_the_truth(noisy(decibel, seed))) for seed in range(100)]
    assert np.mean(errors) == pytest.approx(floor.level, rel=0.02)
    assert np.std(errors) == pytest.approx(floor.level / (2 * floor.number_count) ** 0.5, rel=0.3)


def test_a_fit_of_more_free_numbers_must_come_out_lower_to_reach_the_floor():
    floor = estimate_noise_floor(noisy(40))
    assert floor.explains(floor.level)
    assert floor.explains(floor.largest_error)
    assert not floor.explains(1.01 * floor.largest_error)
    assert not floor.explains(floor.level, floor.number_count // 2)
    assert floor.explains(0.7 * floor.level, floor.number_count // 2)


def test_runs_that_were_repeated_tell_the_noise_of_their_mean():
    one, many = (
        estimate_noise_floor(noisy(40)),
        estimate_noise_floor(noisy(40, repeats=16, record_sigma=False)),
    )
    assert many.source == "repeats"
    assert many.level == pytest.approx(one.level / 4, rel=0.3)  # sigma estimated from 16 runs


def test_data_of_unknown_noise_are_as_good_as_exact_and_measured_by_their_nrmse():
    floor = estimate_noise_floor(CLEAN)
    assert (floor.level, floor.known) == (SCREENING.exact_error, False)
    assert floor.error_of(Record("ok", nrmse=0.02, over_noise=3.0)) == 0.02
    assert floor.explains(0.5 * SCREENING.exact_error, 100)
    assert not floor.explains(2 * SCREENING.exact_error)
    some = (noisy(40).points[0], CLEAN.points[1])
    assert not estimate_noise_floor(replace(CLEAN, points=some)).known


def test_a_record_without_errors_is_infinitely_bad():
    assert (
        estimate_noise_floor(CLEAN).error_of(Record("failed"))
        == estimate_noise_floor(noisy(40)).error_of(Record("failed"))
        == np.inf
    )


def test_no_floor_lies_below_exact():
    def nearly_clean(point: PointSweep) -> PointSweep:
        return replace(point, sigma=np.full(point.admittance.shape, 1e-15))

    assert (
        estimate_noise_floor(replace(CLEAN, points=tuple(map(nearly_clean, CLEAN.points)))).level
        == SCREENING.exact_error
    )


# the criterion


def judged(sweep: Sweep = CLEAN, parameters: str = "shared") -> SelectionCriterion:
    return build_criterion(Study(sweep, parameters=parameters), SETTINGS)


def numbers(sweep: Sweep) -> int:
    return 8 * sum(len(point.frequency) for point in sweep.points)


@pytest.mark.parametrize("parameters", ["shared", "per-op"])
def test_with_known_noise_the_criterion_is_that_of_bayes(parameters):
    one, count = judged(noisy(40), parameters), numbers(CLEAN)
    for error, free in ((0.05, 6), (0.01, 12), (0.011, 11)):
        bayes = count * log(error**2) + free * log(count)
        assert 2 * count * one.score(error, free) == pytest.approx(bayes)


def test_with_unknown_noise_a_free_number_breaks_ties_alone():
    one = judged()
    assert one.score(0.010, 30) < one.score(0.011, 3)
    assert one.score(0.010, 3) < one.score(0.010, 4)


def test_exact_fits_are_alike_but_for_their_size():
    one = judged()
    assert one.score(1e-12, 5) == one.score(1e-9, 5) == one.score(0.0, 5)
    assert one.score(1e-9, 5) < one.score(1e-12, 6)
    assert np.isfinite(one.parent_reward(0.0, 5))


def test_an_oddity_counts_against_a_candidate():
    one = judged()
    assert (
        one.score(0.01, 5)
        < one.score(0.01, 5, PlausibilityIssues(missing=1))
        < one.score(0.01, 5, PlausibilityIssues(1, 1))
    )


# the order of the parents


def test_parents_rank_by_error_then_by_what_they_lack():
    one = judged()
    assert one.parent_reward(0.01, 5) > one.parent_reward(0.02, 5)
    assert one.parent_reward(0.01, 5) - one.parent_reward(0.01, 6) == pytest.approx(
        SETTINGS.parsimony
    )
    assert one.parent_reward(0.01, 5) - one.parent_reward(
        0.01, 5, PlausibilityIssues(missing=1)
    ) == pytest.approx(SETTINGS.layer)
    assert one.parent_reward(0.01, 5) - one.parent_reward(
        0.01, 5, PlausibilityIssues(at_bound=2)
    ) == pytest.approx(2 * SETTINGS.bound)
    assert one.parent_reward(0.01, 5) - one.parent_reward(
        0.01, 5, PlausibilityIssues(residual=1)
    ) == pytest.approx(SETTINGS.residual)


def test_numbers_of_each_operating_point_cost_as_much_as_shared_ones():
    """Each of two points has its own: twice the numbers, and the same price."""
    assert judged(parameters="per-op").parent_reward(0.01, 10) == pytest.approx(
        judged().parent_reward(0.01, 5)
    )


def test_an_absurd_plant_earns_nothing_by_a_perfect_fit():
    one = judged()
    assert one.parent_reward(1e-5, 5, PlausibilityIssues(absurd=1)) == one.parent_reward(
        1e-4, 5, PlausibilityIssues(absurd=1)
    )
    assert one.parent_reward(1e-5, 5) > one.parent_reward(1e-4, 5)
    assert one.parent_reward(0.1, 5, PlausibilityIssues(absurd=1)) == one.parent_reward(0.1, 5)
    assert one.score(1e-5, 5, PlausibilityIssues(absurd=1)) == one.score(
        1e-4, 5, PlausibilityIssues(absurd=1)
    )
