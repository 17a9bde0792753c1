"""The first result for a sweep or for recordings: inspect the data, screen every library diagram,
fit the best few and validate the best one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log
from types import MappingProxyType

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FIT_EFFORTS, FitSettings, require_one_of
from ibrid.gap.recordings.event_evaluation import evaluate_records, fit_and_score
from ibrid.gap.recordings.event_problem import build_event_problem
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.conventions.positive_sequence import NOTE
from ibrid.measurement.quality.event_inspection import inspect_events
from ibrid.measurement.quality.inspect import inspect
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.network.outside import NOTHING, Outside
from ibrid.study import Study
from ibrid.telling import Tell
from ibrid_search.archives.appraisal import sort_of_control
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.edit_screening import EditScreener, ScreeningFit
from ibrid_search.screening.plausibility import find_impossible_values
from ibrid_search.screening.selection_criterion import SelectionCriterion
from ibrid_search.screening.settings import SCREENING
from ibrid_search.starting.control_families import describe_family, list_synchronisations
from ibrid_search.starting.pll_variants import screen_pll_variants
from ibrid_search.starting.start_result import (
    ALTERNATIVE_VERDICTS,
    GOOD_GRADES,
    GRADES,
    DiagramFit,
    StartResult,
)

#: Of a diagram that screening has selected: one restart suffices.
_AFTER_SCREENING = FitSettings(restarts=1)


@dataclass(frozen=True)
class StartSettings:
    """How much work a first result takes, in diagrams.

    `fitted` : fitted after the screening. `fitted_to_events` : the same for recordings alone, until
    one fits. `single_events` : of recordings that no diagram explains together, events tried
    alone, the mildest first. `pll_variants` : grid-following diagrams screened with other PLLs.
    `hopeless` : error of a screening fit beyond which a sweep's diagram is not fitted where another
    explains the data: of 17 shipped sweeps, clean and at 50 dB, no diagram explained one from more
    than 0.02. `fit` : effort of each fit.
    """

    fitted: int = 3
    fitted_to_events: int = 6
    single_events: int = 2
    pll_variants: int = 12
    hopeless: float = 0.1
    fit: FitSettings = _AFTER_SCREENING


#: The settings of each effort.
START_EFFORTS: Mapping[str, StartSettings] = MappingProxyType(
    {
        "low": StartSettings(
            fitted=2,
            fitted_to_events=3,
            single_events=1,
            pll_variants=6,
            fit=FIT_EFFORTS["low"],
        ),
        "normal": StartSettings(),
        "high": StartSettings(
            fitted=6,
            fitted_to_events=12,
            single_events=4,
            pll_variants=24,
            fit=FIT_EFFORTS["normal"],
        ),
    }
)


@hearing_interrupts()
def start(
    data: Sweep | Events,
    *,
    tell: Tell,
    seed: int = 0,
    port: Outside = NOTHING,
    events: Events | None = None,
    effort: str = "normal",
    devices: int = 1,
) -> StartResult:
    """Rank the library diagrams by how well they explain the data.

    All are screened and the best few fitted. Where none with a PLL explains a sweep, the
    grid-following diagrams are tried with other PLLs; where none fits all recordings, single
    events are tried. The best diagram is validated by a fit without the last operating point.

    Parameters
    ----------
    data : Sweep or Events
        A sweep, or recordings where there is none.
    tell : Callable[[str, float | None], None]
        Gets the progress: a description, and the share of the work that is done.
    port : Outside
        Passive elements between the PCC and the filter of the device.
    events : Events, optional
        Recordings in addition to a sweep. The fitted diagrams are then fitted to both and ranked by
        the Bayesian information criterion.
    effort : str
        One of `START_EFFORTS`.
    devices : int
        Behind the terminals, 1 or 2. With 2, a diagram of two devices in parallel is fitted to a
        sweep where none of one device fits.

    Raises
    ------
    IbridError
        No library diagram has a response at these operating points; another number of devices.
    """
    require_one_of("effort", effort, tuple(START_EFFORTS))
    if devices not in (1, 2):
        raise IbridError(f"devices behind the terminals must be 1 or 2, found {devices}")
    settings = START_EFFORTS[effort]
    inspection = inspect_events(data) if isinstance(data, Events) else inspect(data)
    study = Study.of(data, seed=seed, port=port)
    screener = rankings_for(study).screener
    library_fits = screener.screen_library(tell=lambda words, share: tell(words, 0.6 * share))
    if not library_fits:
        raise IbridError(
            "no shipped diagram has a response at these operating points; look at the data with "
            "ibrid inspect"
        )

    fits = _fit_best(library_fits, study, settings, tell)
    screened_only = [DiagramFit(fit.edit.source, fit.error) for fit in library_fits[len(fits) :]]
    single_event = ""
    if study.events is not None:
        if fits[0].grade not in GOOD_GRADES:
            fits, single_event = _fit_single_event(fits, study, study.events, settings, tell)
    else:
        if not _is_explained_by_pll(fits[0], study):
            fits = _add_pll_variants(fits, library_fits, study, settings, tell)
        if devices == 2 and fits[0].grade not in GOOD_GRADES:
            fits = _add_two_devices(fits, screener, study, settings, tell)
    if events is not None:
        tell(f"fitting {len(fits)} diagrams to the recordings too", 0.88)
        joint_fits = [_fit_to_both(fit, study, events) for fit in fits]
        fits = sorted(joint_fits, key=lambda fit: fit.bic)

    best = fits[0]
    if not single_event:
        tell(f"predicting held-out data with {best.diagram}", 0.92)
        best = replace(best, held_out=_validate(best, study, settings))
    ranked = (best, *_order_others(fits[1:], screened_only))
    tell("writing the report", 1.0)
    return StartResult(
        data,
        inspection,
        ranked,
        _describe_control(best, data, study),
        events=events,
        single_event=single_event,
        effort=effort,
        alternative=_find_alternative(best, ranked[1:], study),
        devices=devices,
    )


def _order_others(
    fits: Sequence[DiagramFit], screened_only: Sequence[DiagramFit]
) -> list[DiagramFit]:
    """Order the other diagrams: those that fit, then failed and screened ones by error."""
    worst_grade = GRADES[-1]
    acceptable = [fit for fit in fits if fit.grade != worst_grade]
    failed = [fit for fit in fits if fit.grade == worst_grade]
    by_error = sorted([*failed, *screened_only], key=lambda fit: fit.nrmse)
    return [*acceptable, *by_error]


def _describe_control(best: DiagramFit, data: Sweep | Events, study: Study) -> str:
    """Describe the control family of the best diagram, if the data can identify it."""
    if NOTE in data.notes:
        return "family and dq structure cannot be told from a positive sequence alone"
    return describe_family(sort_of_control(best.structure, study.kinds))


def _find_alternative(best: DiagramFit, others: Sequence[DiagramFit], study: Study) -> str:
    """Return a diagram with the grade of the best one that synchronises by other means, with its
    family; "" if there is none.
    """
    if best.grade not in ALTERNATIVE_VERDICTS:
        return ""
    synchronisations = list_synchronisations(best.structure, study.kinds)
    for other in others:
        if other.grade != best.grade:
            continue
        if synchronisations.isdisjoint(list_synchronisations(other.structure, study.kinds)):
            family = describe_family(sort_of_control(other.structure, study.kinds))
            return f"{other.diagram} ({family})"
    return ""


def _fit_best(
    screening_fits: Sequence[ScreeningFit],
    study: Study,
    settings: StartSettings,
    tell: Tell,
    most: int | None = None,
) -> list[DiagramFit]:
    """Fit the first diagrams of a screening, and return the fits, the best first.

    `settings.fitted` of them, but none that is hopeless once one fits, and for recordings more
    until one fits, up to `settings.fitted_to_events`, or `most` where that is given.
    """
    if most is None:
        most = settings.fitted if study.events is None else settings.fitted_to_events
    fits = list[DiagramFit]()
    for index, screening_fit in enumerate(screening_fits[:most]):
        has_good_fit = any(fit.grade in GOOD_GRADES for fit in fits)
        if has_good_fit and (
            index >= settings.fitted or _is_hopeless(screening_fit, study, settings)
        ):
            break
        share = 0.6 + 0.3 * min(index / settings.fitted, 1.0)
        tell(f"fitting {screening_fit.edit.source}", share)
        fits.append(_fit_diagram(screening_fit, study, settings))
    return _rank_fits(fits, study)


def _is_hopeless(screening_fit: ScreeningFit, study: Study, settings: StartSettings) -> bool:
    """Return True if a fit would not lead from the error of a screening to an explanation."""
    return study.events is None and screening_fit.error > settings.hopeless


def _rank_fits(fits: Sequence[DiagramFit], study: Study) -> list[DiagramFit]:
    """Sort fits: physically possible values first, then by grade, then by the criterion."""
    criterion = rankings_for(study.blind).screener.criterion

    def rank(fit: DiagramFit) -> tuple[bool, int, float]:
        is_impossible = fit.record is not None and bool(find_impossible_values(fit.record))
        return is_impossible, GRADES.index(fit.grade), _score(fit, criterion)

    return sorted(fits, key=rank)


def _score(fit: DiagramFit, criterion: SelectionCriterion) -> float:
    """Return ln(error) with the cost of free parameters, as a search ranks its candidates.

    Without that cost a part that only fits noise would decide.
    """
    if fit.record is None:
        return log(max(fit.nrmse, SCREENING.exact_error))
    return criterion.score(criterion.floor.error_of(fit.record), fit.record.free_parameters)


def _is_explained_by_pll(fit: DiagramFit, study: Study) -> bool:
    """Return True if a diagram explains the data whose frame follows a PLL alone."""
    synchronisations = list_synchronisations(fit.structure, study.kinds)
    return fit.grade in GOOD_GRADES and synchronisations == {"phase"}


def _add_pll_variants(
    fits: list[DiagramFit],
    library_fits: Sequence[ScreeningFit],
    study: Study,
    settings: StartSettings,
    tell: Tell,
) -> list[DiagramFit]:
    """Fit the best grid-following diagrams with other PLLs too, and sort all fits.

    A PLL with a steady-state angle error leaves voltage on its q axis. This couples the voltage
    magnitude to the angle, which otherwise only a power droop does, so that a grid-forming diagram
    may fit by mistake.
    """
    tell("screening grid-following diagrams with other PLLs", 0.85)
    screener = rankings_for(study).screener
    variants = screen_pll_variants(screener, library_fits[: settings.pll_variants], settings.fitted)
    if fits[0].grade in GOOD_GRADES:
        variants = [one for one in variants if not _is_hopeless(one, study, settings)]
    variant_fits = [_fit_diagram(variant, study, settings) for variant in variants]
    return _rank_fits([*fits, *variant_fits], study)


def _add_two_devices(
    fits: list[DiagramFit],
    screener: EditScreener,
    study: Study,
    settings: StartSettings,
    tell: Tell,
) -> list[DiagramFit]:
    """Put the best diagram of two devices in parallel first, if it fits."""
    tell("no diagram of one device fits: trying two in parallel", 0.86)
    pair_fits = [
        _fit_diagram(screening_fit, study, settings)
        for screening_fit in screener.screen_library(2)[:1]
    ]
    return [fit for fit in pair_fits if fit.grade in GOOD_GRADES] + fits


def _fit_single_event(
    failed: list[DiagramFit],
    study: Study,
    events: Events,
    settings: StartSettings,
    tell: Tell,
) -> tuple[list[DiagramFit], str]:
    """Fit single mild events where no diagram explains all of them.

    In a mild event no limiter acts, so that a linear controller can explain it.

    Returns
    -------
    fits : list[DiagramFit]
        The diagram that explains an event alone, then the failed ones; only these if none does.
    name : str
        Of the explained event; "" if none is.
    """
    number = min(settings.single_events, len(events.records) - 1)
    for name in events.mildest_first[:number]:
        tell(f"no diagram fits all events: trying {name} alone", 0.86)
        other_names = [other for other in events.names if other != name]
        event_study = Study.of(study, holdout_op=other_names)
        screening_fits = rankings_for(event_study.blind).screener.screen_library()
        fits = _fit_best(
            screening_fits,
            event_study,
            settings,
            lambda words, share: tell(words, 0.86),
            most=settings.fitted,
        )
        if not fits or fits[0].record is None or fits[0].grade not in GOOD_GRADES:
            continue
        best = replace(fits[0], held_out=dict(fits[0].record.holdout))
        return [best, *(fit for fit in failed if fit.diagram != best.diagram)], name
    return failed, ""


def _fit_diagram(screening_fit: ScreeningFit, study: Study, settings: StartSettings) -> DiagramFit:
    """Fit a diagram completely, from the values of its screening fit."""
    source = screening_fit.edit.source
    diagram = screening_fit.edit.diagram
    initial_values = dict(zip(study.fitted.names, screening_fit.values, strict=True))
    record = _evaluate(diagram, study, initial_values, settings)
    if record.nrmse is None:
        return DiagramFit(source, screening_fit.error, "fails")
    return DiagramFit(source, record.nrmse, str(record.grade), None, record, edited_diagram=diagram)


def _evaluate(
    diagram: Diagram,
    study: Study,
    initial_values: Mapping[str, Mapping[str, float]],
    settings: StartSettings,
) -> Record:
    """Fit a diagram to the data of a study, from values for each operating point."""
    if study.events is not None:
        return evaluate_records(diagram, study, settings.fit, initial_values)
    return evaluate(diagram, study, settings=settings.fit, warm=initial_values)


def _fit_to_both(fit: DiagramFit, study: Study, events: Events) -> DiagramFit:
    """Fit a diagram to sweep and recordings together.

    Returned unchanged, with an infinite `bic`, if it has no steady state in one of the events.
    """
    if fit.record is None:
        return fit
    try:
        record, bic = fit_and_score(build_event_problem(fit.record, study, None, events, {}))
    except IbridError:
        return fit
    nrmse = fit.nrmse if record.nrmse is None else record.nrmse
    return replace(fit, nrmse=nrmse, grade=str(record.grade), record=record, bic=bic)


def _validate(best: DiagramFit, study: Study, settings: StartSettings) -> dict[str, float] | None:
    """Refit the best diagram without the last operating point or event, and return the error there.

    None if there is only one, or if the fit failed.
    """
    names = study.sweep.names
    if best.record is None or len(names) < 2:
        return None
    values = best.record.parameters
    initial_values = {op: values[op] for op in names[:-1] if op in values}
    validation_study = Study.of(study, holdout_op=names[-1])
    record = _evaluate(best.structure, validation_study, initial_values, settings)
    return dict(record.holdout) or None
