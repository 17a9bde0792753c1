"""The fit of one diagram to a sweep: all operating points together, with a prior.

cost(x) = chi2(x) + sum of the squared prior deviations, minimised by batches of damped Gauss-Newton
from many starts. A minimum that is missed looks like a missing effect, so that starts are many, and
better ones are passed on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ibrid.assembly.symbolic import SymbolicModel, symbolic_model
from ibrid.errors import DiagramError
from ibrid.fit.least_squares import LEVENBERG, Batch
from ibrid.fit.multistart import fit as fit_multistart
from ibrid.fit.problem import Misfit, Problem
from ibrid.fit.settings import FitSettings
from ibrid.fit.starts import StartDrawer
from ibrid.fit.twins import find_twins
from ibrid.gap.refitting.diagram_cache import DiagramCache
from ibrid.gap.refitting.model import FitResult, Values
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.refitting.prior import ParameterPrior, Prior
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.measurement.sweeps.sweep import measured_numbers
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.wiring import wire

#: Steps on the logarithm of the response, which leads to the right valley: of all starts, then of
#: the best `KEPT_LOGARITHMIC`.
LOGARITHMIC_STEPS = 5
KEPT_LOGARITHMIC = 12
#: Steps on chi2 of given starts.
GIVEN_STEPS = 15
#: Starts that go on with chi2: of those, and of the logarithmic ones; with steps of all of them,
#: then of the best.
KEPT_GIVEN = 3
KEPT_FROM_LOGARITHMIC = 6
CHI2_STEPS = 12
KEPT_LAST = 3
LAST_STEPS = 60
#: Steps of a screening fit on the logarithm and on chi2, and starts that it follows.
SCREENING_LOGARITHMIC_STEPS = 3
SCREENING_CHI2_STEPS = 5
KEPT_SCREENED = 2
#: Frequencies of all operating points together above which descents begin on a subset, and the
#: operating points and frequencies of each in that.
MANY = 150
SUBSET_POINTS = 4
SUBSET_FREQUENCIES = 24
#: Ends on the subset that go on with all data; steps with all data after a screening fit.
KEPT_OF_SUBSET = 3
SCREENING_LAST_STEPS = 3
#: A fit of a model without nominal values: no further starts far below any noise.
WHOLE = FitSettings(objective="sigma", solved=1e-2)


@dataclass(frozen=True, eq=False)
class SweepFit(FitResult):
    """A diagram at its best parameters.

    Parameters
    ----------
    x : ndarray
        (P,) in search coordinates.
    parameter_prior : ParameterPrior
        Of the problem's free parameters.
    moved : mapping
        Parameter with a nominal value -> its deviation from that, in tolerances.
    """

    diagram: Diagram
    problem: Problem
    prior: Prior
    x: np.ndarray
    parameter_prior: ParameterPrior
    moved: Mapping[str, float]

    @property
    def growth_rates(self) -> list[float] | None:
        """Largest real part of a pole (1/s) at each operating point; None with delays, whose Pade
        forms are another system's.
        """
        problem = self.problem
        if (problem.pattern.delay_parameter != -1).any():
            return None
        matrices = [
            problem.state_matrices(self.x[None], point)[0] for point in range(len(problem.points))
        ]
        return [float(np.linalg.eigvals(matrix).real.max(initial=-np.inf)) for matrix in matrices]

    @cached_property
    def responses(self) -> list[np.ndarray]:
        """Admittances at the measured frequencies, one array (K, 2, 2) for each operating point."""
        return self.problem.responses(self.x)

    @cached_property
    def residuals(self) -> list[np.ndarray]:
        """(Y - data) / sigma, complex, one array (K, 2, 2) for each operating point."""
        pairs = zip(self.responses, self.problem.points, strict=True)
        return [
            (response - point.admittance) / np.asarray(point.sigma) for response, point in pairs
        ]


@dataclass(frozen=True, eq=False)
class FitTask:
    """The fitting problem of one diagram, built once.

    With the prior of its free parameters and the two sums of squares that descents minimise: of
    whitened residuals and of the logarithm of the response.
    """

    problem: Problem
    parameter_prior: ParameterPrior
    chi2: Misfit
    logarithmic: Misfit


class SweepFitter:
    """Fits diagrams to one sweep, its noise and one prior."""

    def __init__(self, noise: Noise, kinds: Vocabulary, prior: Prior, seed: int) -> None:
        self.noise = noise
        self.sweep = noise.sweep
        self.kinds = kinds
        self.prior = prior
        self.seed = seed
        self._symbolic = DiagramCache[SymbolicModel]()
        self._tasks = DiagramCache[FitTask]()
        self._rngs: dict[str, np.random.Generator] = {}
        self._coarse = self._coarse_fitter()

    def with_noise(self, noise: Noise) -> "SweepFitter":
        """Return the fitter of other data.

        Symbolic models are shared where power node and nominal frequency are the same.
        """
        other = SweepFitter(noise, self.kinds, self.prior, self.seed)
        if (noise.sweep.power_node, noise.sweep.f0_hz) == (self.sweep.power_node, self.sweep.f0_hz):
            other._share(self._symbolic)
        return other

    def _share(self, symbolic: DiagramCache[SymbolicModel]) -> None:
        self._symbolic = symbolic
        if self._coarse is not None:
            self._coarse._share(symbolic)

    def _coarse_fitter(self) -> "SweepFitter | None":
        """Return the fitter of a subset of many data, where descents begin; None of few data."""
        points = self.sweep.points
        if sum(len(point.frequency) for point in points) <= MANY:
            return None
        few = replace(self.sweep, points=coarse(points, SUBSET_POINTS, SUBSET_FREQUENCIES))
        other = SweepFitter(replace(self.noise, sweep=few), self.kinds, self.prior, self.seed)
        other._share(self._symbolic)
        return other

    def problem(self, diagram: Diagram) -> Problem:
        """The fitting problem of a legal diagram; DiagramError where that has no matrices."""
        return self._task(diagram).problem

    def _task(self, diagram: Diagram) -> FitTask:
        """Return the task of a diagram, built once; DiagramError where it has no matrices."""

        def build() -> FitTask:
            """Build the fitting problem of the diagram."""
            physics = {
                "equilibrium": "exact",
                "power_node": self.sweep.power_node,
                "omega_0": self.sweep.omega_0,
            }
            model = self._symbolic.get_or_make(
                diagram, lambda: symbolic_model(wire(diagram, self.kinds), **physics)
            )
            problem = Problem(model, self.sweep.points)
            parameter_prior = ParameterPrior(
                [number.parameter for number in problem.numbers], self.prior
            )
            return FitTask(
                problem,
                parameter_prior,
                Misfit(problem, "chi2", parameter_prior),
                Misfit(problem, "log", parameter_prior),
            )

        return self._tasks.get_or_make(diagram, build)

    def fit(
        self, diagram: Diagram, starts: Sequence[Values], *, draws: int = 0, spread: float = 0.7
    ) -> SweepFit | None:
        """Fit a diagram by descents from many starts and return the best end.

        Parameters
        ----------
        starts : sequence of mapping
            Values by name; what they lack is the nominal value.
        draws : int
            Further starts, each a given one moved by `spread` standard deviations of the prior.

        Returns
        -------
        SweepFit or None
            None where no start has a response, or the diagram no matrices.
        """
        try:
            task = self._task(diagram)
        except DiagramError:
            return None
        prior = task.parameter_prior
        x = np.array([prior.start(values) for values in starts])
        if draws:
            drawn = _perturb_starts(x, prior, draws, spread, self._rng(diagram))
            x = np.concatenate([x, drawn])
        if self._coarse is None:
            return self._best(diagram, _descend_starts(task.chi2, task.logarithmic, x, len(starts)))
        subset = self._coarse._task(diagram)
        subset_ends = _descend_starts(subset.chi2, subset.logarithmic, x, len(starts))
        return self._finish(diagram, task.chi2, subset_ends.best(KEPT_OF_SUBSET), LAST_STEPS)

    def _finish(self, diagram: Diagram, chi2: Misfit, ends: Batch, steps: int) -> SweepFit | None:
        """Go on with all data from where descents on a subset ended."""
        begun = LEVENBERG.begin(chi2, ends.x)
        return self._best(diagram, LEVENBERG.go(chi2, begun, steps))

    def _best(self, diagram: Diagram, ends: Batch) -> SweepFit | None:
        """Return the end of least cost; None where none has a response."""
        if not np.isfinite(ends.cost).any():
            return None
        return self.at(diagram, ends.x[int(np.argmin(ends.cost))])

    def fit_without_prior(self, diagram: Diagram) -> SweepFit | None:
        """Refit from where a slow multistart fit without a prior ends, and from its twins.

        Starts around typical values find the right valley of a grid-following inverter; mostly not
        that of cascaded voltage and current control, or of two devices. None without a response.
        """
        problem = (self._coarse or self)._task(diagram).problem
        wiring = wire(diagram, self.kinds)
        omega_0 = self.sweep.omega_0
        drawer = StartDrawer(problem, wiring, omega_0)
        twins = find_twins(problem, wiring, omega_0)
        whole = fit_multistart(problem, drawer, twins, self._rng(diagram), WHOLE)
        if whole is None:
            return None
        return self.fit(diagram, [problem.values_at(x, 0) for x in (whole.x, *whole.twins)])

    def screen(
        self, diagram: Diagram, starts: Sequence[Values], *, near: bool = False
    ) -> SweepFit | None:
        """Fit a diagram by a few steps from the starts: at a tenth of the effort, no better than
        `fit`.

        near : the starts nearly fit, and no other valley is sought. None without a response.
        """
        try:
            task = self._task(diagram)
        except DiagramError:
            return None
        x = np.array([task.parameter_prior.start(values) for values in starts])
        if self._coarse is None:
            return self._best(diagram, _screen_starts(task.chi2, task.logarithmic, x, near))
        subset = self._coarse._task(diagram)
        subset_ends = _screen_starts(subset.chi2, subset.logarithmic, x, near)
        return self._finish(diagram, task.chi2, subset_ends.best(1), SCREENING_LAST_STEPS)

    def at(self, diagram: Diagram, x: np.ndarray) -> SweepFit:
        """Evaluate a diagram at search coordinates x (P,)."""
        task = self._task(diagram)
        problem = task.problem
        cost, _, hessian = task.chi2.parts(x[None])
        data, prior = hessian[0, :-1].sum(axis=0), hessian[0, -1]
        numbers = measured_numbers(problem.points)
        return SweepFit(
            values=problem.values_at(x, 0),
            chi2=float(cost[0, :-1].sum()),
            penalty=float(cost[0, -1]),
            dof=max(numbers - _effective_parameters(data, prior), 1.0),
            measurement_count=numbers,
            parameter_count=problem.size,
            diagram=diagram,
            problem=problem,
            prior=self.prior,
            x=x,
            parameter_prior=task.parameter_prior,
            moved=task.parameter_prior.moved(x),
        )

    def evaluate_values(self, diagram: Diagram, values: Values) -> SweepFit:
        """Evaluate a diagram at values by name; what they lack is the nominal or typical value."""
        return self.at(diagram, self._task(diagram).parameter_prior.start(values))

    def _rng(self, diagram: Diagram) -> np.random.Generator:
        """Return the random numbers of a structure, whatever was fitted before."""
        key = structure_hash(diagram, self.kinds)
        return self._rngs.setdefault(key, np.random.default_rng([self.seed, int(key[:16], 16)]))


def _descend_starts(chi2: Misfit, logarithmic: Misfit, x: np.ndarray, given: int) -> Batch:
    """Descend from starts x (S, P), the first of which were given.

    All go by the logarithm of the response first, the given ones by chi2, too.
    """
    near = LEVENBERG.go(chi2, LEVENBERG.begin(chi2, x[:given]), GIVEN_STEPS)
    far = LEVENBERG.go(logarithmic, LEVENBERG.begin(logarithmic, x), LOGARITHMIC_STEPS)
    far = LEVENBERG.go(logarithmic, far.best(KEPT_LOGARITHMIC), LOGARITHMIC_STEPS)
    kept = np.concatenate([near.best(KEPT_GIVEN).x, far.best(KEPT_FROM_LOGARITHMIC).x])
    ends = LEVENBERG.go(chi2, LEVENBERG.begin(chi2, kept), CHI2_STEPS)
    return LEVENBERG.go(chi2, ends.best(KEPT_LAST), LAST_STEPS)


def _screen_starts(chi2: Misfit, logarithmic: Misfit, x: np.ndarray, near: bool) -> Batch:
    """Descend a few steps from starts x (S, P); near : by chi2 alone."""
    first = LEVENBERG.begin(chi2, x)
    if near:
        steps = SCREENING_LOGARITHMIC_STEPS + SCREENING_CHI2_STEPS
        return LEVENBERG.go(chi2, first.best(KEPT_SCREENED), steps)
    far = LEVENBERG.begin(logarithmic, x)
    far = LEVENBERG.go(logarithmic, far, SCREENING_LOGARITHMIC_STEPS).best(KEPT_SCREENED)
    kept = np.concatenate([first.best(1).x, far.x])
    return LEVENBERG.go(chi2, LEVENBERG.begin(chi2, kept), SCREENING_CHI2_STEPS)


def _perturb_starts(
    x: np.ndarray,
    parameter_prior: ParameterPrior,
    number: int,
    spread: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Sample starts (number, P) from x (S, P), each moved by `spread` deviations of the prior."""
    base = x[rng.integers(len(x), size=number)]
    coordinates = parameter_prior.coordinates
    width = parameter_prior.width(coordinates.to_x(parameter_prior.nominal))
    moved = base + spread * width * rng.standard_normal(base.shape)
    return np.clip(moved, coordinates.x_low, coordinates.x_high)


def _effective_parameters(data: np.ndarray, prior: np.ndarray) -> float:
    """Return trace of D (D + P)^-1, the number of parameters that the data determine.

    data, prior : Hessians D and P of chi2 and of the prior penalty, (P, P) each.
    """
    if not len(data) or not np.isfinite(data).all():
        return float(len(data))
    scale = np.sqrt(np.maximum(np.diag(data + prior), 1e-300))
    scales = np.outer(scale, scale)
    whole = (data + prior) / scales
    part = data / scales
    return float(np.trace(np.linalg.pinv(whole, rcond=1e-12, hermitian=True) @ part))
