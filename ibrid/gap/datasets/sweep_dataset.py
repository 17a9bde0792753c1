"""Trials: every edit of the catalogue, and every way to read the data otherwise, refitted."""

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

#: Draws beside the given starts, of a trial and of the given model.
TRIAL_DRAWS, BASE_DRAWS = 16, 64
#: Whole fits of a given model at most, each with other random numbers.
WHOLE_FITS = 2
#: Frequencies that all operating points must share for a port map.
LEAST_SHARED = 6
#: Of many data, the operating points and frequencies of each on which ports are compared, and how
#: many adequate ones then on all.
MAPPED_POINTS, MAPPED_FREQUENCIES, MAPPED = 4, 40, 4
#: Conventions, the best by a glance, that are refitted.
READ_OTHERWISE = 2
#: Factor on a cost that something else reaches, beyond which a glance at a convention is enough.
HOPELESS = 20.0
#: Angles of a frame (rad) at which a search of it starts.
STARTS = {FRAME: np.linspace(-0.4, 0.4, 7), ROTATION: np.linspace(-1.2, 1.5, 10)}


class SweepDataset(Dataset):
    """A small-signal sweep as a kind of `Dataset`, read in any convention."""

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
        self.noise, self.kinds, self.catalogue = noise, kinds, tuple(catalogue)
        self._plain = SweepFitter(noise, kinds, prior, seed)
        self._refitters: dict[Convention, SweepFitter] = {}
        self._edits = DiagramCache[tuple[Insertion, ...]]()
        self.known_stable: WeakKeyDictionary[Model, bool] = WeakKeyDictionary()

    def refitter(self, convention: Convention) -> SweepFitter:
        """What fits to the data as they read in a convention."""
        if convention == Convention():
            return self._plain
        if convention not in self._refitters:
            if len(self._refitters) > 8:
                self._refitters.clear()
            read = replace(self.noise, sweep=convention.undone(self.noise.sweep))
            self._refitters[convention] = self._plain.of(read)
        return self._refitters[convention]

    def _fit_given(self, diagram: Diagram) -> Model | None:
        """The given model, refitted from many starts; by whole fits where these have no response,
        or values are unknown.
        """
        refitter = self.refitter(Convention())
        refit = refitter.fit(diagram, [{}], draws=BASE_DRAWS) or refitter.fit_without_prior(diagram)
        if refit is None:
            return None
        for _ in range(WHOLE_FITS if len(refit.moved) < refit.parameter_count else 0):
            if refit.is_adequate():
                break
            found = refitter.fit_without_prior(diagram)
            refit = found if found is not None and found.cost < refit.cost else refit
        return Model(diagram, Convention(), refit)

    def _refit_model(
        self, model: Model, starts: Sequence[Values], *, draws: int, spread: float
    ) -> Model | None:
        """A model refitted from starts; None where it has no response."""
        refit = self.refitter(model.convention).fit(
            model.diagram, starts, draws=draws, spread=spread
        )
        return None if refit is None else replace(model, refit=refit)

    def is_stable(self, model: Model) -> bool:
        """True when all poles lie in the left half plane at every fitted point."""
        if model not in self.known_stable:
            self.known_stable[model] = self._has_stable_poles(model)
        return self.known_stable[model]

    def _has_stable_poles(self, model: Model) -> bool:
        refit, sweep = model.refit, self.refitter(model.convention).sweep
        if isinstance(refit, SweepFit) and (rates := refit.growth_rates) is not None:
            return max(rates) < STABLE_BELOW
        record = record_at(model.diagram, sweep, refit.values, vocabulary=self.kinds)
        return bool(record.stable) and all(record.stable.values())

    def insertions(self, model: Model) -> tuple[Insertion, ...]:
        """All edits of a model, the same ones whenever its diagram comes again: their matrices are
        derived once.
        """
        diagram = model.diagram
        return self._edits.of(diagram, lambda: insertions(diagram, self.kinds, self.catalogue))

    def _fit_edit(
        self, model: Model, insertion: Insertion, *, quick: Sequence[Values]
    ) -> Model | None:
        """A model with an edit, refitted from its own and from nominal values with finite strengths
        of the effect.

        quick : from these values alone, without further draws.
        """
        changed = replace(model, diagram=insertion.diagram, edits=(*model.edits, insertion))
        starts = start_values(insertion, quick or (model.refit.values, {}))
        return self._refit_model(changed, starts, draws=0 if quick else TRIAL_DRAWS, spread=0.5)

    def _screen_edit(self, model: Model, insertion: Insertion, *, near: bool) -> Model | None:
        """A model with an edit, after a few steps; what a refit finds is no worse.

        near : from its own values alone, of a model that fits already; else from nominal ones too.
        """
        starts = start_values(
            insertion, (model.refit.values,) if near else (model.refit.values, {})
        )
        refit = self.refitter(model.convention).screen(insertion.diagram, starts, near=near)
        if refit is None:
            return None
        return replace(
            model, diagram=insertion.diagram, refit=refit, edits=(*model.edits, insertion)
        )

    def fit_other_conventions(self, model: Model, enough: float) -> Iterator[Model]:
        """A model on the data as they read in other conventions, refitted where a glance speaks for
        one.

        enough : a cost that something else reaches; what a glance finds `HOPELESS` times beyond it
        is left. Another nominal frequency takes up a part of whatever is missing, and decoupling
        does what it does: it must explain all by itself.
        """
        if self.labels == "exact":
            return
        by_noise = measured_numbers(self.noise.sweep.points)
        frequencies = [one for one in self._conventions if one.frequency]
        for convention in frequencies if model.convention == Convention() else ():
            if self._screen_convention(model, convention) <= HOPELESS * by_noise:
                yield from (
                    one
                    for one in self._fit_in_convention(model, convention, 0)
                    if one.is_adequate()
                )
        glances = [
            (self._screen_convention(model, one), one)
            for one in self._conventions
            if not one.frequency
        ]
        for cost, convention in sorted(glances, key=lambda pair: pair[0])[:READ_OTHERWISE]:
            if cost <= HOPELESS * enough:
                yield from self._fit_in_convention(model, convention, 0)
        for label in LABELS if model.convention == Convention() else ():
            value = self._fit_label_value(model, label, enough, Convention())
            for number, extra in () if value is None else usual_first(label, value):
                yield from self._fit_in_convention(model, Convention.of(label, number), extra)
        if model.convention == Convention():
            yield from self._fit_in_rotated_frames(model, enough)

    def compute_port_map(
        self, given: Model, steps: list[str], repaired: Model | None = None
    ) -> tuple[PortFit, ...]:
        """The port map at the frequencies that all operating points share; empty where there are
        too few.
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
        free = set(given.refit.values)
        if repaired is None:
            starts: list[Values] = [given.refit.values, {}]
        else:
            starts = [
                {name: value for name, value in repaired.refit.values.items() if name in free}
            ]
        few = coarse(points, MAPPED_POINTS, MAPPED_FREQUENCIES)
        looked_at = replace(sweep, points=few)
        kinds, prior = self.kinds, self._plain.prior
        fits = port_map(given.diagram, kinds, looked_at, prior, starts, look=repaired is not None)
        self.budget.spend(len(fits))
        names = [one.port.name for one in fits if one.adequate][:MAPPED]
        if repaired is not None or not names or _frequency_count(few) == _frequency_count(points):
            return fits
        whole = replace(sweep, points=points)  # what a few of the data allow all of them must
        starts = [one.values for one in fits if one.port.name in names]
        sure = port_map(given.diagram, kinds, whole, prior, starts, only=names, look=True)
        self.budget.spend(len(sure))
        return (*sure, *(one for one in fits if not one.adequate))

    @cached_property
    def _conventions(self) -> tuple[Convention, ...]:
        """Those without a number to be fitted that the first look at the data leaves."""
        return tuple(written_otherwise(self.noise.sweep))

    def cross_validate(self, model: Model) -> ValidationErrors:
        """Errors where a model was not fitted."""
        return cross_validate(self.refitter(model.convention), self.noise, model)

    def _screen_convention(self, model: Model, convention: Convention) -> float:
        self.budget.spend()
        refit = self.refitter(convention).screen(model.diagram, (model.refit.values, {}))
        return np.inf if refit is None else refit.cost

    def _fit_in_convention(
        self, model: Model, convention: Convention, extra: int
    ) -> Iterator[Model]:
        other = replace(
            model,
            convention=convention,
            edits=(*model.edits, convention),
            extra=model.extra + extra,
        )
        found = self.refit_model(other, [model.refit.values, {}], draws=TRIAL_DRAWS)
        if found is not None:
            yield found

    def _fit_in_rotated_frames(self, model: Model, enough: float) -> Iterator[Model]:
        """A model on the data of a frame turned beyond what is called misaligned, and of one that
        is turned by another angle at each operating point. So many angles take up a part of
        whatever is missing: they must explain all by themselves.
        """
        for sector in SECTORS:
            value = self._fit_label_value(model, FRAME, enough, read_in=Convention(angle=sector))
            angle = 0.0 if value is None else half_turn(sector + value)
            if abs(angle) > MISALIGNED:
                yield from self._fit_in_convention(model, Convention(angle=angle), 1)
        names = self.noise.sweep.names
        by_noise = measured_numbers(self.noise.sweep.points)
        refit = (
            self._fit_with_free_label(model, ROTATION, min(enough, by_noise), Convention())
            if len(names) > 1
            else None
        )
        if refit is not None:
            places = enumerate(names)
            angles = [
                (name, half_turn(refit.problem.values_at(refit.x, k)[f"{LABEL}.{ROTATION}"]))
                for k, name in places
            ]
            yield from (
                one
                for one in self._fit_in_convention(
                    model, Convention(angles=tuple(angles)), len(angles)
                )
                if one.is_adequate()
            )

    def _fit_label_value(
        self, model: Model, label: str, enough: float, read_in: Convention
    ) -> float | None:
        """The number of a doubted label at which a model fits best, beside its parameters; None
        where a glance is hopeless.
        """
        refit = self._fit_with_free_label(model, label, enough, read_in)
        return None if refit is None else refit.values[f"{LABEL}.{label}"]

    def _fit_with_free_label(
        self, model: Model, label: str, enough: float, read_in: Convention
    ) -> SweepFit | None:
        """A model with a doubted label free, on the data as they read in a convention; None where a
        glance is hopeless.
        """
        outside, name = model.diagram.outside, f"{LABEL}.{label}"
        labelled = model.diagram.behind(replace(outside, labels=(*outside.labels, label)))
        usual = STARTS.get(label, (*PEAKS, 3.0, 1 / 3))
        starts = [
            {**values, name: float(one)} for one in usual for values in (model.refit.values, {})
        ]
        refitter = self.refitter(read_in)
        self.budget.spend()
        glance = refitter.screen(labelled, starts)
        if glance is None or glance.cost > HOPELESS * enough:
            return None
        self.budget.spend()
        return refitter.fit(labelled, [glance.values])


def start_values(insertion: Insertion, origins: Sequence[Values]) -> list[dict[str, float]]:
    """Values of a model with each of the finite strengths of an effect."""
    length = max((len(bank) for bank in insertion.parameters.values()), default=1)
    banks = [
        {name: bank[min(j, len(bank) - 1)] for name, bank in insertion.parameters.items()}
        for j in range(length)
    ]
    return [{**values, **bank} for bank in banks for values in origins]


def _frequency_count(points: Sequence[PointSweep]) -> int:
    return sum(len(point.frequency) for point in points)
