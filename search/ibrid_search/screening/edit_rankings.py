"""The edits of a fitted candidate, ranked by how much of its error they explain.

Stages are screened from the likely to the unlikely (effects of the catalogue, other usual edits,
pairs and exchanges of what is confused, blocks and wires anywhere) until an edit promises enough.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import islice
from math import inf, isfinite, log

from ibrid.errors import IbridError
from ibrid.gap.ports.missing_transfer import measure_transfer
from ibrid.gap.ports.port_map import PortFit, port_map
from ibrid.gap.refitting.noise import estimate_noise
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text
from ibrid.study import Study
from ibrid_search.evaluated import Evaluated
from ibrid_search.screening.candidate_edits import (
    CandidateEdit,
    list_arbitrary_edits,
    list_delay_form_edits,
    list_effect_edits,
    list_exchange_edits,
    list_family_edits,
    list_layer_edits,
    unchanged,
)
from ibrid_search.screening.edit_screening import (
    EditScreener,
    ScreeningFit,
    Values,
    rank_fits,
)
from ibrid_search.screening.event_screening import EventEditScreener
from ibrid_search.screening.selection_criterion import NoiseFloor, build_criterion
from ibrid_search.screening.settings import SCREENING
from ibrid_search.settings import SearchSettings

#: Lists the edits of a diagram that one stage screens.
EditLister = Callable[[Diagram, Study], list[CandidateEdit]]


class EditRankings:
    """Rank the edits of the candidates of one study; rankings are cached."""

    def __init__(self, study: Study, screener: EditScreener) -> None:
        self.study = study
        self.screener = screener
        self._edit_lists: dict[str, list[CandidateEdit]] = {}
        self._port_fits: dict[str, tuple[PortFit, ...]] = {}

    @property
    def _floor(self) -> NoiseFloor:
        """Return the noise floor of the study."""
        return self.screener.criterion.floor

    @cached_property
    def library_fits(self) -> tuple[ScreeningFit, ...]:
        """Return the screening fits of the library diagrams of one device, the best first."""
        return self.screener.screen_library()

    def best_edits(
        self,
        parent: Evaluated,
        is_new: Callable[[Diagram], bool],
        number: int = 1,
        *,
        thorough: bool = True,
    ) -> list[ScreeningFit]:
        """Return the best edits of a candidate that lead to new structures, the best first.

        While the error is gross and a control layer is missing, edits that insert a layer come
        first. Otherwise the stages are screened in turn until an edit gains half of ln(error /
        noise), or `ScreeningSettings.promising_gain` if that is less.

        Parameters
        ----------
        is_new : Callable
            True for the diagram of a structure that may be proposed.
        number : int
            Of edits returned at most. Empty if no edit has a response.
        thorough : bool
            Also screen pairs, and blocks and wires anywhere, unless the parent's error is
            explained by noise.
        """
        error = self._error(parent)
        parent_score = self.screener.score(error, parent.record.free_parameters)
        if self._is_gross(parent):
            layer_fits = self._rank(parent.diagram, self._values(parent), list_layer_edits)
            layer_score = parent_score - SCREENING.layer_gain
            layer_fits = [
                fit for fit in layer_fits if fit.score < layer_score and is_new(fit.edit.diagram)
            ]
            if layer_fits:
                return layer_fits[:number]

        explainable = log(max(error / self._floor.largest_error, 1.0))
        sufficient_score = parent_score - min(SCREENING.promising_gain, explainable / 2)
        stages = self._stages(parent)
        if not (thorough and error > self._floor.largest_error):
            stages = islice(stages, SCREENING.single_edit_stages)
        best: list[ScreeningFit] = []
        for fits in stages:
            new_fits = (fit for fit in fits if fit.values and is_new(fit.edit.diagram))
            best = rank_fits([*best, *islice(new_fits, number)])[:number]
            if best and best[0].score < sufficient_score:
                break
        return best

    def _stages(self, parent: Evaluated) -> Iterator[list[ScreeningFit]]:
        """Yield the screening fits of each stage, the best first.

        Effects with the forms of delays (once the error is not gross), other usual edits, pairs and
        exchanges of effects that are confused, blocks and wires anywhere. For recordings alone,
        where a ranking takes a minute, only the first two.
        """
        diagram = parent.diagram
        values = self._values(parent)
        at_noise = self._error(parent) <= self._floor.largest_error
        effect_fits = self._rank(diagram, values, list_effect_edits, at_noise)
        delay_fits: list[ScreeningFit] = []
        if not self._is_gross(parent):
            delay_fits = self._rank(diagram, values, list_delay_form_edits, at_noise)
        yield rank_fits([*effect_fits, *delay_fits])
        family_fits = self._rank(diagram, values, list_family_edits, at_noise)
        yield family_fits
        if self.study.events is not None:
            return
        by_error = sorted([*effect_fits, *family_fits], key=lambda fit: fit.error)
        pair_fits = self._rank_pairs(by_error[: SCREENING.pair_seeds])
        exchange_fits = self._rank(diagram, values, list_exchange_edits)
        yield rank_fits([*pair_fits, *exchange_fits])
        yield self._rank(diagram, values, list_arbitrary_edits)

    def _rank(
        self,
        diagram: Diagram,
        values: Values,
        list_edits: EditLister,
        at_noise: bool = False,
    ) -> list[ScreeningFit]:
        """Screen the listed edits of a fitted diagram; the best first."""
        key = f"{list_edits.__name__} {program_text(diagram)}"
        if key not in self._edit_lists:
            if len(self._edit_lists) >= SCREENING.cached_edit_lists:
                self._edit_lists.clear()
            self._edit_lists[key] = list_edits(diagram, self.study)
        return self.screener.rank_edits(self._edit_lists[key], values, at_noise=at_noise)

    def _rank_pairs(self, first_fits: Sequence[ScreeningFit]) -> list[ScreeningFit]:
        """Screen the pairs of a first edit and an effect; the best first.

        All pairs get a quick screening fit, from the fitted values of the first edit, and the best
        of these a complete one.
        """
        pairs: list[tuple[CandidateEdit, Values]] = []
        for first in first_fits:
            for second in list_effect_edits(first.edit.diagram, self.study):
                pair = replace(
                    second,
                    description=f"{first.edit.description}; {second.description}",
                    source=f"{first.edit.source} + {second.source}",
                )
                pairs.append((pair, first.values))
        self.screener.begin_stage(pairs)
        quick_fits = [
            (self.screener.screen_from_parent(pair, values, quick=True), values)
            for pair, values in pairs
        ]
        quick_fits.sort(key=lambda fit_and_values: fit_and_values[0].score)
        polished = quick_fits[: SCREENING.polished_pairs]
        self.screener.begin_stage(polished)
        return rank_fits(
            self.screener.screen_from_parent(quick_fit.edit, values)
            for quick_fit, values in polished
        )

    def locate_unknown_transfers(self, parent: Evaluated) -> tuple[PortFit, ...]:
        """Return the ports of a candidate where one unknown transfer function explains the error.

        `port_map` fits an additive transfer function at each port with the parameters kept; ports
        are returned where it leaves less than `ScreeningSettings.explained_share` of chi2 per
        degree of freedom, the best first. Empty where noise explains the error, for recordings
        alone, and where operating points have their own parameters or frequencies.
        """
        physics = (self.study.parameters, self.study.equilibrium, self.study.events)
        if physics != ("shared", "exact", None):
            return ()
        if self._error(parent) <= self._floor.largest_error:
            return ()
        key = f"{program_text(parent.diagram)} {parent.record.nrmse}"
        if key not in self._port_fits:
            self._port_fits[key] = tuple(self._explaining_ports(parent))
        return self._port_fits[key]

    def _explaining_ports(self, parent: Evaluated) -> Iterator[PortFit]:
        """Yield the best ports with the transfer function there and its deviation.

        The transfer function is read off at the fitted parameters, on a coarse grid of operating
        points and frequencies.
        """
        kinds = self.study.kinds
        noise = estimate_noise(self.study.fitted)
        points = coarse(
            noise.sweep.points, SCREENING.max_operating_points, SCREENING.max_frequencies
        )
        noise = replace(noise, sweep=replace(noise.sweep, points=points))
        diagram = self.study.placed(parent.diagram)
        try:
            port_fits = port_map(diagram, kinds, noise.sweep, {}, self._values(parent)[:1])
        except IbridError:  # operating points with different frequencies
            return
        chi2_per_dof = (parent.record.misfit or {}).get("chi2_per_dof") or 0.0
        for fit in port_fits[: SCREENING.reported_ports]:
            if fit.chi2_per_dof < SCREENING.explained_share * chi2_per_dof:
                transfer, deviation = measure_transfer(
                    fit, kinds, noise, fit.values, 1.0 + fit.transfer
                )
                yield replace(fit, transfer=transfer, deviation=deviation)

    def removal_loss(self, parent: Evaluated, reduced: Diagram) -> float:
        """Return what a candidate loses by a removal, from screening fits.

        With known noise of a sweep: the increase of ln(error) in equivalent free parameters, minus
        the free parameters saved; a removal pays where it is negative. Otherwise the increase of
        ln(error). Infinite where no recording can be simulated without the part.
        """
        values = self._values(parent)
        reduced_fits = self.screener.rank_edits([unchanged(reduced)], values)
        if not reduced_fits:
            return inf
        reduced_fit = reduced_fits[0]
        if self._floor.known and self.study.events is None:
            parent_fit = self.screener.rank_edits([unchanged(parent.diagram)], values)[0]
            if isfinite(parent_fit.error):
                error_increase = log(reduced_fit.error / parent_fit.error)
                equivalent_parameters = error_increase / self.screener.parameter_cost
                return equivalent_parameters + reduced_fit.free - parent_fit.free
        smallest_error = SCREENING.exact_screening_error
        if self._floor.known:
            smallest_error = self._floor.largest_error
        reduced_error = max(reduced_fit.error, smallest_error)
        return log(reduced_error / max(self._error(parent), smallest_error))

    def _is_gross(self, parent: Evaluated) -> bool:
        """Return True if the error calls for another structure rather than for a detail."""
        noise_limit = SCREENING.gross_noise_ratio * self._floor.level
        return self._error(parent) > max(SCREENING.gross_error, noise_limit)

    def _error(self, parent: Evaluated) -> float:
        """Return the error of a candidate as the run measures it."""
        return self._floor.error_of(parent.record)

    def _values(self, parent: Evaluated) -> Values:
        """Return the fitted values of a candidate at each fitted operating point."""
        return [parent.record.parameters[name] for name in self.study.fitted.names]


@lru_cache(maxsize=2)
def rankings_for(study: Study) -> EditRankings:
    """Return the rankings of a study; the same object for every caller, since fits are cached."""
    screener_type = EditScreener if study.events is None else EventEditScreener
    return EditRankings(study, screener_type(study, build_criterion(study, SearchSettings())))
