"""The criterion by which fitted candidates are compared: ln(error) plus a cost for every free
parameter, down to the error that the noise of the data explains.
"""

from dataclasses import dataclass, field
from math import inf, log, sqrt

import numpy as np

from ibrid.evaluation.outcome import reward
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import NEGLIGIBLE
from ibrid.gap.recordings.evaluation_record import noise_nrmse
from ibrid.gap.recordings.event_noise import estimate_event_noise
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.sweep import Sweep, measured_numbers
from ibrid.study import Study
from ibrid_search.screening.plausibility import NO_ISSUES, PlausibilityIssues
from ibrid_search.screening.settings import SCREENING
from ibrid_search.settings import SearchSettings

#: `NoiseFloor.source` where the data do not reveal their noise.
UNKNOWN_NOISE = "unknown noise"
#: Sources of a noise estimate that may end a search; smoothness gives only an upper bound.
RELIABLE_SOURCES = ("sigma", "repeats", "vector-fit")


@dataclass(frozen=True)
class NoiseFloor:
    """Hold the error that the noise of the data explains.

    With known noise an error is the residual in standard deviations times `level`, so that it
    means the same at every frequency. Otherwise it is the NRMSE, and the floor is the error of an
    exact fit.

    `level` : relative noise, sqrt(2) |sigma| / |Y|. `number_count` : measured real numbers n.
    `source` : of the noise estimate, or `UNKNOWN_NOISE`.
    """

    level: float
    number_count: int
    source: str

    @property
    def known(self) -> bool:
        """Return True if the noise is known."""
        return self.source != UNKNOWN_NOISE

    @property
    def largest_error(self) -> float:
        """Return the largest error that noise explains.

        With known noise, level (1 + 2 / sqrt(2 n)): the root mean square of n normal residuals has
        the standard deviation 1 / sqrt(2 n), and two of these are allowed; at least an excess of
        the variance that is negligible.
        """
        if not self.known:
            return SCREENING.exact_error
        two_deviations = 1.0 + 2.0 / sqrt(2.0 * self.number_count)
        return self.level * max(two_deviations, sqrt(1.0 + NEGLIGIBLE))

    def error_of(self, record: Record) -> float:
        """Return the error of a fit, infinite if it did not converge."""
        if self.known:
            return inf if record.over_noise is None else record.over_noise * self.level
        return inf if record.nrmse is None else record.nrmse

    def explains(self, error: float, free_parameters: int = 0) -> bool:
        """Return True if noise explains the error that a fit leaves.

        A fit of k parameters to n numbers reduces the expected residual by sqrt(1 - k / n).
        """
        degrees_of_freedom = 1.0
        if self.known:
            degrees_of_freedom = max(1.0 - free_parameters / self.number_count, 0.0)
        expected = self.largest_error * sqrt(degrees_of_freedom)
        return error <= max(expected, SCREENING.exact_error)


def estimate_noise_floor(sweep: Sweep) -> NoiseFloor:
    """Estimate the noise floor of a sweep from sigma, repeats or vector fits.

    The level is the mean over frequencies and operating points of sqrt(2) |sigma|_F / |Y|_F. It is
    unknown if one operating point has no reliable estimate.
    """
    number_count = measured_numbers(sweep.points)
    relative_noise = []
    source = UNKNOWN_NOISE
    for point in sweep.points:
        noise = estimate_point(point)
        if noise.relative is None or noise.source not in RELIABLE_SOURCES:
            return NoiseFloor(SCREENING.exact_error, number_count, UNKNOWN_NOISE)
        relative_noise.append(noise.relative)
        source = noise.source
    level = float(np.mean(np.concatenate(relative_noise)))
    return NoiseFloor(max(level, SCREENING.exact_error), number_count, source)


def estimate_study_noise_floor(study: Study) -> NoiseFloor:
    """Estimate the noise floor of the fitted data of a study.

    For recordings alone the level is the mean of sqrt(2) |sigma| / |i - i_steady|.
    """
    events = study.blind.events
    if events is None:
        return estimate_noise_floor(study.fitted)
    noise = estimate_event_noise(events, study.fitted)
    number_count = sum(2 * len(event.time) for event in events.records)
    return NoiseFloor(noise_nrmse(noise), number_count, noise.source)


@dataclass(frozen=True)
class SelectionCriterion:
    """Compare fitted candidates by ln(error) + cost x free parameters.

    With known noise this is the Bayesian information criterion divided by 2n: with chi2
    proportional to error^2, BIC / 2n = ln(error) + k ln(n) / 2n. With unknown noise the cost only
    breaks ties.

    `floor` : of the noise. `parameter_cost` : ln(error) per free parameter of one parameter set.
    `parameter_sets` : 1, or the number of operating points that have their own parameters.
    `settings` : of the search, with the costs that rank parents.
    """

    floor: NoiseFloor
    parameter_cost: float
    parameter_sets: int = 1
    settings: SearchSettings = field(default_factory=SearchSettings)

    def score(
        self, error: float, free_parameters: int, issues: PlausibilityIssues = NO_ISSUES
    ) -> float:
        """Return the criterion of a result, the lower the better.

        A plausibility issue counts as `ScreeningSettings.implausibility_cost` free parameters.
        """
        equivalent_parameters = (
            free_parameters / self.parameter_sets + SCREENING.implausibility_cost * issues.total
        )
        return log(credited_error(error, issues)) + self.parameter_cost * equivalent_parameters

    def parent_reward(
        self, error: float, free_parameters: int, issues: PlausibilityIssues = NO_ISSUES
    ) -> float:
        """Return the reward by which the archive ranks parents, the higher the better."""
        costs = self.settings
        parameter_costs = costs.parsimony * free_parameters + costs.bound * issues.at_bound
        return (
            reward(credited_error(error, issues))
            - parameter_costs / self.parameter_sets
            - costs.layer * issues.missing
            - costs.residual * issues.residual
        )


def credited_error(error: float, issues: PlausibilityIssues) -> float:
    """Return the error that a candidate is credited with: not below that of an exact fit, nor below
    `ScreeningSettings.doubtful_error` if its plant values are absurd.
    """
    return max(error, SCREENING.doubtful_error if issues.absurd else SCREENING.exact_error)


def bic_parameter_cost(number_count: int, parameter_sets: int) -> float:
    """Return the cost of a free parameter in ln(error) by the Bayesian information criterion.

    ln(n) / 2n for n measured real numbers, times the number of parameter sets.

    References
    ----------
    Schwarz, Ann. Stat. 6, 1978; Ljung, System Identification, 1999, section 16.4.
    """
    return log(number_count) * parameter_sets / (2 * number_count)


def build_criterion(study: Study, settings: SearchSettings) -> SelectionCriterion:
    """Build the criterion for the fitted operating points of a study."""
    floor = estimate_study_noise_floor(study)
    parameter_sets = len(study.groups)
    parameter_cost = SCREENING.tie_cost
    if floor.known:
        parameter_cost = bic_parameter_cost(floor.number_count, parameter_sets)
    return SelectionCriterion(floor, parameter_cost, parameter_sets, settings)
