"""A small-signal sweep as a dataset of the gap workflow, read in any convention."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, reduce
from weakref import WeakKeyDictionary

import numpy as np

from ibrid.evaluation.describe import STABLE_BELOW
from ibrid.evaluation.evaluate import record_at
from ibrid.evaluation.reading import usual_first
from ibrid.gap.budget import Budget
from ibrid.gap.datasets.dataset import Dataset
from ibrid.gap.ports.port_map import PortFit, port_map
from ibrid.gap.refitting.cross_validation import ValidationErrors, cross_validate
from ibrid.gap.refitting.diagram_cache import DiagramCache
from ibrid.gap.refitting.model import Model, Values
from ibrid.gap.refitting.noise import Noise
from ibrid.gap.refitting.prior import Prior
from ibrid.gap.refitting.sweep_fitter import SweepFit, SweepFitter
from ibrid.measurement.conventions.labels import (
    FRAME,
    MISALIGNED,
    ROTATION,
    SECTORS,
    Convention,
    written_otherwise,
)
from ibrid.measurement.conventions.rotation import half_turn
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.measurement.sweeps.sweep import PointSweep, measured_numbers
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.catalogue import insertions
from ibrid.parts.editing.practice import Effect, Insertion
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.network.outside import LABEL, LABELS, PEAKS

#: Random starts beside the given ones, of a trial and of the given model; their spread about the
#: values of a trial, in standard deviations of the prior.
TRIAL_DRAWS = 16
GIVEN_DRAWS = 64
TRIAL_SPREAD = 0.5
#: Multistart fits of a given model without nominal values at most, each with other random numbers.
MOST_MULTISTARTS = 2
#: Frequencies that all operating points must share for a port map.
LEAST_SHARED = 6
#: Operating points, and frequencies of each, on which the ports are compared where there are many
#: data; and how many adequate ports are then compared on all.
MAPPED_POINTS = 4
MAPPED_FREQUENCIES = 40
MAPPED_PORTS = 4
#: Conventions that are refitted, the best by screening.
REFITTED_CONVENTIONS = 2
#: Factor on a cost that another trial reaches, above which a convention is not refitted.
HOPELESS_COST = 20.0
#: Sweep fitters of other conventions that are kept.
MOST_FITTERS = 8
#: Angles of the measuring frame, rad, at which a fit of it starts.
START_ANGLES = {FRAME: np.linspace(-0.4, 0.4, 7), ROTATION: np.linspace(-1.2, 1.5, 10)}


class SweepDataset(Dataset):
    """A small-signal sweep, weighted by its noise.

    Edits are those of control practice, and other conventions of the data.

    Parameters
    ----------
    noise : Noise
        Of the sweep; holds it.
    kinds : Vocabulary
        Module kinds that edits may use.
    prior : Prior
        Nominal values with tolerances.
    catalogue : sequence of Effect
        Effects that may be missing.
    seed : int
        Of the random starts.
    labels : str
        "exact" where the conventions of the data are certain, else "uncertain".
    budget : Budget
        Of the search.
    """

    beam_width = 6

    def __init__(
        self,
        noise: Noise,
        kinds: Vocabulary,
        prior: Prior,
        catalogue: Sequence[Effect],
        seed: int,
        labels: str = "uncertain",
        budget: Budget | None = None,
    ) -> None:
        super().__init__(budget)
        self.labels = labels
        self.noise = noise
        self.kinds = kinds
        self.catalogue = tuple(catalogue)
        self._fitter = SweepFitter(noise, kinds, prior, seed)
        self._fitters: dict[Convention, SweepFitter] = {}
        self._edits = DiagramCache[tuple[Insertion, ...]]()
        self.known_stable: WeakKeyDictionary[Model, bool] = WeakKeyDictionary()

    def fitter_for(self, convention: Convention) -> SweepFitter:
        """Return the fitter to the data as they read in a convention."""
        if convention == Convention():
            return self._fitter
        if convention not in self._fitters:
            if len(self._fitters) > MOST_FITTERS:
                self._fitters.clear()
            noise = replace(self.noise, sweep=convention.undone(self.noise.sweep))
            self._fitters[convention] = self._fitter.with_noise(noise)
        return self._fitters[convention]

    # --- fits

    def _fit_given(self, diagram: Diagram) -> Model | None:
        """Fit the given model from nominal values and random starts.

        By multistart fits without a prior where these have no response, or values are unknown.
        """
        fitter = self.fitter_for(Convention())
        fit = fitter.fit(diagram, [{}], draws=GIVEN_DRAWS) or fitter.fit_without_prior(diagram)
        if fit is None:
            return None
        has_unknown_values = len(fit.moved) < fit.parameter_count
        for _ in range(MOST_MULTISTARTS if has_unknown_values else 0):
            if fit.is_adequate():
                break
            other = fitter.fit_without_prior(diagram)
            if other is not None and other.cost < fit.cost:
                fit = other
        return Model(diagram, Convention(), fit)

    def _refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """Refit a model from starts; None where it has no response."""
        fitter = self.fitter_for(model.convention)
        refit = fitter.fit(model.diagram, starts, draws=draws, spread=spread)
        return None if refit is None else replace(model, refit=refit)

    def is_stable(self, model: Model) -> bool:
        """Whether all poles lie in the left half plane at every fitted operating point."""
        if model not in self.known_stable:
            self.known_stable[model] = self._has_stable_poles(model)
        return self.known_stable[model]

    def _has_stable_poles(self, model: Model) -> bool:
        refit = model.refit
        growth_rates = refit.growth_rates if isinstance(refit, SweepFit) else None
        if growth_rates is not None:
            return max(growth_rates) < STABLE_BELOW
        sweep = self.fitter_for(model.convention).sweep
        record = record_at(model.diagram, sweep, refit.values, vocabulary=self.kinds)
        return bool(record.stable) and all(record.stable.values())

    # --- edits

    def insertions(self, model: Model) -> tuple[Insertion, ...]:
        """List all edits of a model; the same objects for the same diagram, so that the matrices
        of each are derived once.
        """
        diagram = model.diagram
        return self._edits.get_or_make(
            diagram, lambda: insertions(diagram, self.kinds, self.catalogue)
        )

    def _fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """Fit a model with an edit from its own and from nominal values, with initial values of
        the effect.

        quick : values from which alone it is fitted, without random starts.
        """
        changed = replace(model, diagram=insertion.diagram, edits=(*model.edits, insertion))
        starts = start_values(insertion, quick or (model.refit.values, {}))
        draws = 0 if quick else TRIAL_DRAWS
        return self._refit_model(changed, starts, draws=draws, spread=TRIAL_SPREAD)

    def _screen_edit(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """Fit a model with an edit by a few steps; the result of a fit is no worse.

        near : from its own values alone, of a model that fits already; else from nominal ones too.
        """
        origins = (model.refit.values,) if near else (model.refit.values, {})
        starts = start_values(insertion, origins)
        refit = self.fitter_for(model.convention).screen(insertion.diagram, starts, near=near)
        if refit is None:
            return None
        edits = (*model.edits, insertion)
        return replace(model, diagram=insertion.diagram, refit=refit, edits=edits)

    def cross_validate(self, model: Model) -> ValidationErrors:
        """Refit a model on parts of the data and return its error on the parts left out."""
        return cross_validate(self.fitter_for(model.convention), self.noise, model)

    # --- conventions

    def fit_other_conventions(self, model: Model, enough: float) -> Iterator[Model]:
        """Fit a model to the data as they read in other conventions, where screening favours one.

        Another nominal frequency takes up a part of whatever is missing, and decoupling does what
        it does: it must explain the data by itself.

        enough : cost that another trial reaches; a convention with `HOPELESS_COST` times that by
        screening is not fitted.
        """
        if self.labels == "exact":
            return
        as_given = model.convention == Convention()
        if as_given:
            yield from self._fit_other_frequencies(model)
        screened = [
            (self._screen_convention(model, convention), convention)
            for convention in self._conventions
            if not convention.frequency
        ]
        ranked = sorted(screened, key=lambda pair: pair[0])
        for cost, convention in ranked[:REFITTED_CONVENTIONS]:
            if cost <= HOPELESS_COST * enough:
                yield from self._fit_in_convention(model, convention, 0)
        if as_given:
            yield from self._fit_scales(model, enough)
            yield from self._fit_in_rotated_frames(model, enough)

    @cached_property
    def _conventions(self) -> tuple[Convention, ...]:
        """Conventions without a parameter that the data do not exclude at once."""
        return tuple(written_otherwise(self.noise.sweep))

    @property
    def _noise_cost(self) -> float:
        """The cost that noise alone is expected to leave."""
        return measured_numbers(self.noise.sweep.points)

    def _fit_other_frequencies(self, model: Model) -> Iterator[Model]:
        """Fit a model with other nominal frequencies, and yield where that explains the data."""
        for convention in self._conventions:
            if not convention.frequency:
                continue
            if self._screen_convention(model, convention) <= HOPELESS_COST * self._noise_cost:
                for fitted in self._fit_in_convention(model, convention, 0):
                    if fitted.is_adequate():
                        yield fitted

    def _fit_scales(self, model: Model, enough: float) -> Iterator[Model]:
        """Fit a model with each scale of the data free, then with usual values near the fitted."""
        for label in LABELS:
            value = self._fit_label_value(model, label, enough, Convention())
            if value is None:
                continue
            for number, extra in usual_first(label, value):
                yield from self._fit_in_convention(model, Convention.of(label, number), extra)

    def _fit_in_rotated_frames(self, model: Model, enough: float) -> Iterator[Model]:
        """Fit a model to the data of a rotated measuring frame.

        By one angle beyond what counts as misaligned; and by another angle at each operating point,
        which take up a part of whatever is missing: they must explain the data by themselves.
        """
        for sector in SECTORS:
            value = self._fit_label_value(model, FRAME, enough, read_in=Convention(angle=sector))
            angle = 0.0 if value is None else half_turn(sector + value)
            if abs(angle) > MISALIGNED:
                yield from self._fit_in_convention(model, Convention(angle=angle), 1)
        names = self.noise.sweep.names
        if len(names) < 2:
            return
        reached = min(enough, self._noise_cost)
        fit = self._fit_with_free_label(model, ROTATION, reached, Convention())
        if fit is None:
            return
        angles: list[tuple[str, float]] = []
        for k, name in enumerate(names):
            rotation = fit.problem.values_at(fit.x, k)[f"{LABEL}.{ROTATION}"]
            angles.append((name, half_turn(rotation)))
        convention = Convention(angles=tuple(angles))
        for fitted in self._fit_in_convention(model, convention, len(angles)):
            if fitted.is_adequate():
                yield fitted

    def _screen_convention(self, model: Model, convention: Convention) -> float:
        """Return the cost of a model in a convention after a few steps; infinite without a
        response.
        """
        self.budget.spend()
        starts = (model.refit.values, {})
        fit = self.fitter_for(convention).screen(model.diagram, starts)
        return np.inf if fit is None else fit.cost

    def _fit_in_convention(
        self, model: Model, convention: Convention, extra: int
    ) -> Iterator[Model]:
        """Yield the fit of a model in a convention; nothing without a response.

        extra : free parameters of the convention.
        """
        other = replace(
            model,
            convention=convention,
            edits=(*model.edits, convention),
            extra=model.extra + extra,
        )
        fitted = self.refit_model(other, [model.refit.values, {}], draws=TRIAL_DRAWS)
        if fitted is not None:
            yield fitted

    def _fit_label_value(
        self, model: Model, label: str, enough: float, read_in: Convention
    ) -> float | None:
        """Return the value of a label at which a model fits best; None where that is hopeless."""
        fit = self._fit_with_free_label(model, label, enough, read_in)
        return None if fit is None else fit.values[f"{LABEL}.{label}"]

    def _fit_with_free_label(
        self, model: Model, label: str, enough: float, read_in: Convention
    ) -> SweepFit | None:
        """Fit a model with a label of the data as a free parameter.

        None where the cost after screening is `HOPELESS_COST` times `enough`.

        read_in : convention in which the data are read.
        """
        network = model.diagram.outside
        name = f"{LABEL}.{label}"
        labelled = model.diagram.behind(replace(network, labels=(*network.labels, label)))
        initial = START_ANGLES.get(label, (*PEAKS, 3.0, 1 / 3))
        starts = [
            {**values, name: float(value)}
            for value in initial
            for values in (model.refit.values, {})
        ]
        fitter = self.fitter_for(read_in)
        self.budget.spend()
        screened = fitter.screen(labelled, starts)
        if screened is None or screened.cost > HOPELESS_COST * enough:
            return None
        self.budget.spend()
        return fitter.fit(labelled, [screened.values])

    # --- the port map

    def compute_port_map(
        self, given: Model, steps: list[str], repaired: Model | None = None
    ) -> tuple[PortFit, ...]:
        """Compute the port map at the frequencies that all operating points share.

        Empty where these are too few.

        repaired : a model that explains the data, from whose values a few steps are enough.
        """
        sweep = self.noise.sweep
        shared = reduce(np.intersect1d, [point.frequency for point in sweep.points])
        if len(shared) < LEAST_SHARED:
            steps.append(
                f"no port map: the operating points share {len(shared)} frequencies, it needs "
                f"{LEAST_SHARED}"
            )
            return ()
        points = tuple(point.at(np.isin(point.frequency, shared)) for point in sweep.points)
        subset = coarse(points, MAPPED_POINTS, MAPPED_FREQUENCIES)
        starts: list[Values] = [given.refit.values, {}]
        if repaired is not None:
            values = repaired.refit.values
            starts = [{name: values[name] for name in values if name in given.refit.values}]
        few_steps = repaired is not None
        fits = self._map_ports(given, subset, starts, few_steps=few_steps)
        adequate = [fit.port.name for fit in fits if fit.adequate][:MAPPED_PORTS]
        is_whole = _frequency_count(subset) == _frequency_count(points)
        if repaired is not None or not adequate or is_whole:
            return fits
        # what a part of the data allows, all of them must
        starts = [fit.values for fit in fits if fit.port.name in adequate]
        confirmed = self._map_ports(given, points, starts, only=adequate, few_steps=True)
        return (*confirmed, *(fit for fit in fits if not fit.adequate))

    def _map_ports(
        self,
        given: Model,
        points: Sequence[PointSweep],
        starts: Sequence[Values],
        *,
        only: Sequence[str] | None = None,
        few_steps: bool,
    ) -> tuple[PortFit, ...]:
        """Compute the port map on some points; each port is an experiment."""
        sweep = replace(self.noise.sweep, points=tuple(points))
        prior = self._fitter.prior
        fits = port_map(
            given.diagram, self.kinds, sweep, prior, starts, only=only, few_steps=few_steps
        )
        self.budget.spend(len(fits))
        return fits


def start_values(insertion: Insertion, origins: Sequence[Values]) -> list[dict[str, float]]:
    """Return values of a model with each set of initial values of an effect.

    origins : values of the other parameters.
    """
    most = max((len(values) for values in insertion.parameters.values()), default=1)
    initial = [
        {name: values[min(k, len(values) - 1)] for name, values in insertion.parameters.items()}
        for k in range(most)
    ]
    return [{**origin, **values} for values in initial for origin in origins]


def _frequency_count(points: Sequence[PointSweep]) -> int:
    return sum(len(point.frequency) for point in points)
