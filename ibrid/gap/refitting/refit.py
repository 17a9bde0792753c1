"""The refit of one diagram: all operating points together, whitened by the noise, held to nominal
values by a prior.

cost(x) = chi2(x) + sum of the squared `Beliefs.sigmas`, minimised by batches of damped Gauss-Newton
from many starts. A minimum that is missed looks exactly like a missing effect, so starts are many
and whoever finds a better one passes it on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ibrid.assembly.symbolic import SymbolicModel, symbolic_model
from ibrid.errors import DiagramError
from ibrid.fit.least_squares import LEVENBERG, Batch
from ibrid.fit.multistart import fit
from ibrid.fit.problem import Misfit, Problem
from ibrid.fit.settings import FitSettings
from ibrid.fit.starts import StartDrawer
from ibrid.fit.twins import find_twins
from ibrid.gap.refitting.kept import DiagramCache
from ibrid.gap.refitting.model import FitResult, Values
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.refitting.prior import ParameterPrior, Prior
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.measurement.sweeps.sweep import measured_numbers
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.wiring import wire

#: Iterations on the logarithm of the response, which leads to the right valley, and on chi2: of all
#: starts, then of the best.
FAR, NEAR = (5, 5), (12, 60)
#: On chi2, of starts that were given, beside the logarithm.
GIVEN = 15
#: The same of a glance, and how many starts it follows to its end.
GLANCE_FAR, GLANCE_NEAR, GLANCED = 3, 5, 2
#: Starts that go on with the logarithm, those that go on to chi2 from either, and those that end
#: there.
KEPT, LED, ENDED = 12, (3, 6), 3
#: Frequencies of all operating points together beyond which descents begin on a few; the points and
#: frequencies of each that these are at most; ends that go on with all data, and their steps after
#: a glance.
MANY, MOST_POINTS, MOST_FREQUENCIES, CARRIED, POLISH = 150, 4, 24, 3, 3
#: A fit of a model whose parameters nobody has stated: no further starts are needed far below any
#: noise.
WHOLE = FitSettings(objective="sigma", solved=1e-2)


@dataclass(frozen=True, eq=False)
class SweepFit(FitResult):
    """A diagram at its best parameters.

    `x` : (P,) in search coordinates. `parameter_prior` : of the problem's free numbers. `moved` :
    parameter with a nominal value -> how far it is from that, in standard deviations of its
    tolerance.
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
        return [float(np.linalg.eigvals(one).real.max(initial=-np.inf)) for one in matrices]

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
    """What a diagram has to be fitted to, made once for each: the data as a problem in its free
    numbers, what is believed of these, and the two sums of squares in which descents go, of
    whitened residuals and of logarithms.
    """

    problem: Problem
    parameter_prior: ParameterPrior
    chi2: Misfit
    logarithmic: Misfit


class SweepFitter:
    """Fits diagrams to the same data."""

    def __init__(self, noise: Noise, kinds: Vocabulary, prior: Prior, seed: int) -> None:
        self.noise, self.sweep, self.kinds, self.prior, self.seed = (
            noise,
            noise.sweep,
            kinds,
            prior,
            seed,
        )
        self._symbolic, self._tasks = DiagramCache[SymbolicModel](), DiagramCache[FitTask]()
        self._rngs: dict[str, np.random.Generator] = {}
        self._coarse = self._coarse_fitter()

    def of(self, noise: Noise) -> "SweepFitter":
        """The same for other data; models are derived once for each power node and nominal
        frequency.
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
        """The same on a few of many data, where descents begin; None where there are not many."""
        points = self.sweep.points
        if sum(len(point.frequency) for point in points) <= MANY:
            return None
        few = replace(self.sweep, points=coarse(points, MOST_POINTS, MOST_FREQUENCIES))
        other = SweepFitter(replace(self.noise, sweep=few), self.kinds, self.prior, self.seed)
        other._share(self._symbolic)
        return other

    def problem(self, diagram: Diagram) -> Problem:
        """The fitting problem of a legal diagram; DiagramError where that has no matrices."""
        return self._task(diagram).problem

    def _task(self, diagram: Diagram) -> FitTask:
        """DiagramError where a diagram has no matrices."""

        def made() -> FitTask:
            physics = {
                "equilibrium": "exact",
                "power_node": self.sweep.power_node,
                "omega_0": self.sweep.omega_0,
            }
            model = self._symbolic.of(
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

        return self._tasks.of(diagram, made)

    def fit(
        self, diagram: Diagram, starts: Sequence[Values], *, draws: int = 0, spread: float = 0.7
    ) -> SweepFit | None:
        """The best of many descents; None when no start has a response, or the diagram no matrices.

        starts : values by name; what they lack is the nominal value, or drawn. draws : further
        starts, each a `starts` entry moved by `spread` standard deviations of the prior.
        """
        try:
            task = self._task(diagram)
        except DiagramError:
            return None
        x = np.array([task.parameter_prior.start(values) for values in starts])
        if draws:
            x = np.concatenate(
                [x, _perturb_starts(x, task.parameter_prior, draws, spread, self._rng(diagram))]
            )
        if self._coarse is None:
            return self._best(diagram, _descend_starts(task.chi2, task.logarithmic, x, len(starts)))
        few = self._coarse._task(diagram)
        ends = _descend_starts(few.chi2, few.logarithmic, x, len(starts)).best(CARRIED)
        return self._best(
            diagram, LEVENBERG.go(task.chi2, LEVENBERG.begin(task.chi2, ends.x), NEAR[1])
        )

    def _best(self, diagram: Diagram, ends: Batch) -> SweepFit | None:
        return (
            self.at(diagram, ends.x[int(np.argmin(ends.cost))])
            if np.isfinite(ends.cost).any()
            else None
        )

    def fit_without_prior(self, diagram: Diagram) -> SweepFit | None:
        """A refit from where a fit without any prior ends, and from its twins, which takes long;
        None where there is none.

        Draws around typical values find the right valley of a grid-following inverter. Of a cascade
        of voltage and current control, or of two devices, they mostly do not.
        """
        problem = (self._coarse or self)._task(diagram).problem
        wiring, omega_0 = wire(diagram, self.kinds), self.sweep.omega_0
        drawer, twins = StartDrawer(problem, wiring, omega_0), find_twins(problem, wiring, omega_0)
        whole = fit(problem, drawer, twins, self._rng(diagram), WHOLE)
        if whole is None:
            return None
        return self.fit(diagram, [problem.values_at(x, 0) for x in (whole.x, *whole.twins)])

    def screen(
        self, diagram: Diagram, starts: Sequence[Values], *, near: bool = False
    ) -> SweepFit | None:
        """A diagram after a few steps from the starts: an upper end of what a refit finds, at a
        tenth of its cost.

        near : the starts fit nearly, and no other valley is looked for. None where no start has a
        response, or the diagram no matrices.
        """
        try:
            task = self._task(diagram)
        except DiagramError:
            return None
        x = np.array([task.parameter_prior.start(values) for values in starts])
        if self._coarse is None:
            return self._best(diagram, _screen_starts(task.chi2, task.logarithmic, x, near))
        few = self._coarse._task(diagram)
        ends = _screen_starts(few.chi2, few.logarithmic, x, near).best(1)
        return self._best(
            diagram, LEVENBERG.go(task.chi2, LEVENBERG.begin(task.chi2, ends.x), POLISH)
        )

    def at(self, diagram: Diagram, x: np.ndarray) -> SweepFit:
        """A diagram at given search coordinates (P,)."""
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
        """A diagram at values by name; what they lack is the nominal or the typical value."""
        return self.at(diagram, self._task(diagram).parameter_prior.start(values))

    def _rng(self, diagram: Diagram) -> np.random.Generator:
        """Of a structure: what else was fitted before it does not matter."""
        key = structure_hash(diagram, self.kinds)
        return self._rngs.setdefault(key, np.random.default_rng([self.seed, int(key[:16], 16)]))


def _descend_starts(chi2: Misfit, logarithmic: Misfit, x: np.ndarray, given: int) -> Batch:
    """Where starts x (S, P) lead, the first of which were given."""
    near = LEVENBERG.go(chi2, LEVENBERG.begin(chi2, x[:given]), GIVEN)
    far = LEVENBERG.go(logarithmic, LEVENBERG.begin(logarithmic, x), FAR[0]).best(KEPT)
    far = LEVENBERG.go(logarithmic, far, FAR[1])
    kept = np.concatenate([near.best(LED[0]).x, far.best(LED[1]).x])
    return LEVENBERG.go(
        chi2, LEVENBERG.go(chi2, LEVENBERG.begin(chi2, kept), NEAR[0]).best(ENDED), NEAR[1]
    )


def _screen_starts(chi2: Misfit, logarithmic: Misfit, x: np.ndarray, near: bool) -> Batch:
    """Starts x (S, P) after a few steps; near : with whitened residuals alone."""
    first = LEVENBERG.begin(chi2, x)
    if near:
        return LEVENBERG.go(chi2, first.best(GLANCED), GLANCE_FAR + GLANCE_NEAR)
    far = LEVENBERG.go(logarithmic, LEVENBERG.begin(logarithmic, x), GLANCE_FAR).best(GLANCED)
    return LEVENBERG.go(
        chi2, LEVENBERG.begin(chi2, np.concatenate([first.best(1).x, far.x])), GLANCE_NEAR
    )


def _perturb_starts(
    x: np.ndarray,
    parameter_prior: ParameterPrior,
    number: int,
    spread: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """So many of the starts x (S, P), each moved by `spread` standard deviations of what is
    believed.
    """
    base = x[rng.integers(len(x), size=number)]
    coordinates = parameter_prior.coordinates
    width = parameter_prior.width(coordinates.to_x(parameter_prior.nominal))
    moved = base + spread * width * rng.standard_normal(base.shape)
    return np.clip(moved, coordinates.x_low, coordinates.x_high)


def _effective_parameters(data: np.ndarray, prior: np.ndarray) -> float:
    """Trace of data (data + prior)^-1: how many parameters the data decide. data, prior : (P,
    P).
    """
    if not len(data) or not np.isfinite(data).all():
        return float(len(data))
    scale = np.sqrt(np.maximum(np.diag(data + prior), 1e-300))
    whole, part = (data + prior) / np.outer(scale, scale), data / np.outer(scale, scale)
    return float(np.trace(np.linalg.pinv(whole, rcond=1e-12, hermitian=True) @ part))
