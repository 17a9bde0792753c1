"""The gap workflow: refit the model, locate the misfit, repair, name what is missing, validate."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Unpack

from ibrid.border import takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit import kernel
from ibrid.gap.amplitudes.amplitude_data import AmplitudeData, build_amplitude_data
from ibrid.gap.amplitudes.amplitude_dataset import AmplitudeDataset
from ibrid.gap.budget import Budget
from ibrid.gap.datasets.dataset import Dataset
from ibrid.gap.datasets.sweep_dataset import TRIAL_DRAWS, SweepDataset
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.progress import ProgressReporter
from ibrid.gap.recordings.event_dataset import EventDataset
from ibrid.gap.recordings.event_problem import NO_EQUILIBRIUM, EventProblem, build_event_problem
from ibrid.gap.refitting.cross_validation import predicts_no_worse
from ibrid.gap.refitting.model import (
    Model,
    Values,
    estimate_noise_scale,
    explains_data,
    rank_by_bic,
)
from ibrid.gap.refitting.noise import Noise, estimate_noise
from ibrid.gap.refitting.prior import Nominal, Prior, build_prior, fitted_values
from ibrid.gap.repair import (
    RepairState,
    eliminate_backward,
    explain_with_other_delays,
    rank_first_trials,
    repair,
)
from ibrid.gap.results.amplitude_gap import (
    NonlinearityResult,
    report_no_named_nonlinearity,
    report_nonlinearity_alone,
    report_nonlinearity_too,
)
from ibrid.gap.results.event_gap import build_event_gap
from ibrid.gap.results.gap import AmplitudeResult, Gap
from ibrid.gap.results.suggested_edits import Suggest, low_order_blocks
from ibrid.gap.results.sweep_gap import build_sweep_gap
from ibrid.gap.results.verdict import Findings, decide_verdict, relative_misfit
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.amplitudes import at_amplitudes
from ibrid.measurement.sweeps.linearity import Linearity, linearity, small_signal
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.parts.catalogue import CATALOGUE
from ibrid.parts.editing.practice import Effect
from ibrid.structure.compiling.check import require_legal
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire
from ibrid.study import Study, StudyOptions
from ibrid.telling import Tell, telling

#: Searches at most where the noise is unknown, each with the residual of the one before as noise.
MOST_SEARCHES = 3
#: Frequencies that each operating point must keep for a small-signal model of several amplitudes.
FEWEST = 4


@takes_kinds
@hearing_interrupts()
def find_gap(
    diagram: Diagram | Record,
    sweep: Sweep | Study | None,
    values: Nominal | None = None,
    *,
    catalogue: Sequence[Effect] | None = None,
    suggest: Sequence[Suggest] = (low_order_blocks,),
    progress: str | Tell = "interactive",
    effort: str = "normal",
    so_far: Callable[[Gap], None] | None = None,
    events: Events | None = None,
    **options: Unpack[StudyOptions],
) -> Gap:
    """Find where a model and a measurement disagree and which physical effect is missing.

    Parameters
    ----------
    diagram : Diagram or Record
        The given model; of a record, its fitted values are the nominal ones.
    sweep : Sweep, Study or None
        The measured device. With several injection amplitudes the response is tested for linearity
        first; where it fails, a current limit or a dead zone is sought.
    values : mapping
        Nominal values, name -> value or {"value", "tolerance"}: a prior of the refit, with one
        standard deviation of the logarithm 0.25 for the plant and ln 2 for everything else.
    catalogue : sequence of Effect
        Effects that may be missing, also `(*CATALOGUE, MINE)`; `CATALOGUE` when not given.
    suggest : sequence of Suggest
        Sources of further edits where something is located that the catalogue does not know.
    progress : str or Tell
        Where progress is shown: "interactive" (a terminal or a notebook), "auto", "terminal",
        "plain", "notebook", "silent"; or a function of (words, share).
    effort : str
        "low", "normal" or "high": experiments after which nothing new is tried
        (`ibrid.gap.budget.EXPERIMENTS`). The result is then the best so far, `complete` is
        False, and it excludes nothing.
    so_far : Callable
        Is given the intermediate result every 10 s.
    events : Events
        Event records, fitted together with the sweep, or alone where that is None. Limits and
        protections are sought, too, and `holdout_op` may name records.
    holdout_op, vocabulary, seed, port, labels
        As of `ibrid.study.Study`, but that labels are uncertain unless declared exact. Parameters
        are shared and the equilibrium is exact.

    Returns
    -------
    Gap
        With one of six verdicts: no-gap, parameters-only, named, located-unnamed, unexplained,
        data-convention.

    Raises
    ------
    IbridError
        An illegal model, a name that it lacks, an operating point that the sweep lacks, or no fit.
    """
    effects = CATALOGUE if catalogue is None else tuple(catalogue)
    if events is not None:
        event_problem = build_event_problem(diagram, sweep, values, events, options)
        return _find_event_gap(event_problem, effects, progress, effort, so_far)
    if isinstance(sweep, Study) and sweep.events is not None:
        raise IbridError("a study of records alone has no admittances; give its records as events")
    if isinstance(diagram, Record):
        values = values or fitted_values(diagram)
        diagram = diagram.diagram
    if sweep is None:
        raise IbridError("a gap is sought in a sweep, in events, or in both; found neither")
    study = Study.of(sweep, **options)
    if (study.parameters, study.equilibrium) != ("shared", "exact"):
        raise IbridError(
            "a gap is sought with shared parameters and the exact equilibrium; leave other options "
            "out"
        )
    study = replace(study, labels=options.get("labels", "uncertain"))
    kernel.load()
    require_legal(diagram, study.kinds, equilibrium="exact")
    diagram = study.placed(diagram)
    wiring = wire(diagram, study.kinds)
    prior = build_prior(values or {}, wiring, parameter_table(wiring, "exact"))
    gate = linearity(study.fitted)
    budget = Budget(effort)
    with telling(progress) as tell:
        reporter = ProgressReporter(tell, so_far)
        problem = _GapProblem(diagram, study, values, prior, effects, suggest, reporter, budget)
        gap = _find_sweep_gap(problem) if gate is None else _find_amplitude_gap(problem, gate)
    return replace(gap, **budget.summarise(gap.sentence))


def _find_event_gap(
    event_problem: EventProblem,
    catalogue: tuple[Effect, ...],
    progress: str | Tell,
    effort: str,
    so_far: Callable[[Gap], None] | None,
) -> Gap:
    """Find the gap in event records, alone or with a sweep.

    Records that a program of fixed time steps may have made are read as such where that leaves a
    clearly smaller residual of the given model or of its best trial.
    """
    kernel.load()
    budget = Budget(effort)
    with telling(progress) as tell:
        reporter = ProgressReporter(tell, so_far)
        problem, data = _build_event_dataset(event_problem, catalogue, reporter, budget)
        given = _fit_given(problem, data)
        first_trials = None
        stepped = event_problem.in_fixed_steps
        if given is not None and stepped is not None:
            stepped_problem, stepped_data = _build_event_dataset(
                stepped, catalogue, reporter, budget
            )
            is_stepped, (given,) = stepped_data.explains_better_than([given], data)
            if not is_stepped:
                first_trials = _rank_first_trials(problem, data, given)
                is_stepped, _ = stepped_data.explains_better_than(first_trials.leading, data)
            if is_stepped:
                problem = stepped_problem
                data = stepped_data
                given = _fit_given(problem, data)
                first_trials = None
        if given is None:
            raise IbridError(NO_EQUILIBRIUM)
        if first_trials is None:
            first_trials = _rank_first_trials(problem, data, given)
        findings = _verify_sampling_noise(problem, data, _repair_and_validate(first_trials))
    gap = problem.answer(findings, data)
    return replace(gap, **budget.summarise(gap.sentence))


def _verify_sampling_noise(
    problem: "_GapProblem", data: EventDataset, findings: Findings
) -> Findings:
    """Check findings against the sampling noise that the named model itself implies.

    Where the named model does not explain the records by that noise, a competing edit that does
    takes its place.
    """
    fitter = data.fitter
    if decide_verdict(findings) != "named" or not data.is_refuted_by_own_noise(findings.best):
        return findings
    rivals = data.list_rivals(findings.given, findings.best)
    best = next((rival for rival in rivals if rival.is_adequate() and data.is_stable(rival)), None)
    if best is None:
        data.use_noise_of(fitter)
        return findings
    step = (
        "the answer does not explain the records as far as it tells itself what sampling leaves "
        "open"
    )
    given = data.reevaluate(findings.given)
    state = RepairState(data, problem.progress, [*findings.steps, step], findings.tests)
    return _validate(state, given, rivals, *eliminate_backward(state, given, best, rivals))


def _build_event_dataset(
    event_problem: EventProblem,
    catalogue: tuple[Effect, ...],
    progress: ProgressReporter,
    budget: Budget,
) -> tuple["_GapProblem", EventDataset]:
    """Return the problem of recordings as one of the workflow, and its dataset."""
    prior = event_problem.prior()
    problem = _GapProblem(
        diagram=event_problem.diagram,
        swept=event_problem.study,
        values=event_problem.values,
        prior=prior,
        catalogue=catalogue,
        suggest=(),
        progress=progress,
        budget=budget,
        events=event_problem,
    )
    return problem, event_problem.build_dataset(prior, catalogue, budget)


@dataclass(frozen=True, eq=False)
class _GapProblem:
    """The problem that `find_gap` is given.

    Parameters
    ----------
    diagram : Diagram
        The given model.
    swept : Study or None
        The sweeps; None for event records alone.
    values : mapping or None
        Nominal values as given; `prior` is what they mean.
    catalogue : tuple of Effect
        Effects that may be missing.
    suggest : sequence of Suggest
        Sources of further edits.
    events : EventProblem or None
        The event records, where there are some.
    """

    diagram: Diagram
    swept: Study | None
    values: Nominal | None
    prior: Prior
    catalogue: tuple[Effect, ...]
    suggest: Sequence[Suggest]
    progress: ProgressReporter
    budget: Budget
    events: EventProblem | None = None

    @property
    def study(self) -> Study:
        """The study of the sweeps."""
        assert self.swept is not None, "records alone ask for no sweep"
        return self.swept

    def with_sweep(self, sweep: Sweep) -> "_GapProblem":
        """Return the problem with another sweep."""
        return replace(self, swept=replace(self.study, sweep=sweep))

    def sweep_dataset(self, noise: Noise) -> SweepDataset:
        """Return the small-signal sweep, weighted by a noise."""
        study = self.study
        return SweepDataset(
            noise, study.kinds, self.prior, self.catalogue, study.seed, study.labels, self.budget
        )

    def answer(self, findings: Findings, data: Dataset, suggest: Sequence[Suggest] = ()) -> Gap:
        """Return the Gap of findings; it excludes nothing where the budget was spent."""
        complete = findings.complete and not self.budget.stopped
        findings = replace(findings, complete=complete)
        if isinstance(data, EventDataset) and self.events is not None:
            return build_event_gap(findings, data, self.events)
        assert isinstance(data, SweepDataset), "amplitudes are answered by `_find_amplitude_gap`"
        study = self.study
        return build_sweep_gap(
            findings, data, self.diagram, study.sweep, study.held, self.values, suggest
        )


# --- one injection amplitude
# ----------------------------------------------------------------------------------------------


def _find_sweep_gap(problem: _GapProblem) -> Gap:
    """Find the gap in a sweep with one injection amplitude.

    Where every model leaves more than the measured noise, the data are weighted by the residual of
    models instead.
    """
    noise = estimate_noise(problem.study.fitted)
    result = _find_with_noise(problem, noise)
    if result is None:
        raise IbridError(
            "the model has no response at these operating points; check p, q, v and the per-unit "
            "base"
        )
    findings, dataset = result
    is_unexplained = decide_verdict(findings) == "unexplained"
    if noise.known and is_unexplained and not problem.budget.is_exhausted():
        model_error = noise.with_model_error(relative_misfit(findings.best))
        loose = _find_with_noise(problem, model_error) or result
        result = _explain_after_all(problem, findings, dataset, loose[0].best) or loose
    suggest = () if problem.budget.is_exhausted() else problem.suggest
    return problem.answer(*result, suggest)


def _explain_after_all(
    problem: _GapProblem, findings: Findings, dataset: SweepDataset, loose: Model
) -> tuple[Findings, SweepDataset] | None:
    """Refit a model found by looser weights; None where the measured noise rejects it.

    loose : the best model of data weighted by the residual of models.
    """
    if not loose.edits:
        return None
    best = dataset.refit_model(loose, [loose.refit.values], draws=TRIAL_DRAWS)
    if best is None or not explains_data(best, dataset.noise, findings.scale):
        return None
    step = "the noise of models led to what fits the noise of the data"
    state = RepairState(dataset, problem.progress, [*findings.steps, step], findings.tests)
    given = findings.given
    trials = list(findings.trials)
    repaired = eliminate_backward(state, given, best, trials)
    return _validate(state, given, trials, *repaired), dataset


# --- several injection amplitudes
# ----------------------------------------------------------------------------------------------


def _find_amplitude_gap(problem: _GapProblem, gate: Linearity) -> Gap:
    """Find the gap in sweeps at several injection amplitudes.

    Where the response depends on the amplitude by more than intermodulation causes, a nonlinearity
    is sought in all amplitudes together, and the small-signal sweep keeps the other frequencies.

    gate : linearity of the fitted points.
    """
    sweep = problem.study.sweep
    small = small_signal(sweep, gate)
    kept = 0 if small is None else min(len(point.frequency) for point in small.points)
    answer = AmplitudeResult(gate, kept)
    if not len(gate.refused) and small is not None:
        gap = _find_sweep_gap(problem.with_sweep(small))
        return replace(gap, sentence=f"{gap.sentence} {gate.sentence}", amplitude=answer)
    smallest = at_amplitudes(sweep)[0]
    if answer.kept < FEWEST:
        small = None
    data = build_amplitude_data(problem.study.fitted)
    nonlinear = None
    if data is not None:
        nonlinear = _find_nonlinearity(problem, problem.diagram, data, answer)
    if nonlinear is not None and nonlinear.best is not None and nonlinear.is_named:
        gap = _answer_linear(problem, smallest if small is None else small, nonlinear.best.values)
        nominal = None
        if problem.values:
            linear = nonlinear.dataset.sweep_fitter.evaluate_values(problem.diagram, {})
            nominal = nonlinear.dataset.data.linear_nrmse(linear.responses)
        return report_nonlinearity_alone(gap, nonlinear, nominal)
    if small is None:
        values = {} if nonlinear is None else nonlinear.findings.given.refit.values
        linear_gap = _answer_linear(problem, smallest, values)
        return report_no_named_nonlinearity(linear_gap, nonlinear, answer)
    gap = _find_sweep_gap(problem.with_sweep(small))
    if gap.verdict == "named" and data is not None:
        with_repair = _find_nonlinearity(problem, gap.diagram, data, answer)
        if with_repair is not None and with_repair.is_named:
            return report_nonlinearity_too(gap, with_repair)
    return report_no_named_nonlinearity(gap, nonlinear, answer)


def _find_nonlinearity(
    problem: _GapProblem, diagram: Diagram, data: AmplitudeData, gate: AmplitudeResult
) -> NonlinearityResult | None:
    """Find a nonlinearity of a linear model in all amplitudes; None where that has no response."""
    study = problem.study
    dataset = AmplitudeDataset(data, study.kinds, problem.prior, study.seed, problem.budget)
    findings = _find_in_dataset(problem, diagram, dataset, ())
    return None if findings is None else NonlinearityResult(findings, dataset, gate)


def _answer_linear(problem: _GapProblem, sweep: Sweep, values: Values) -> Gap:
    """Return the answer of the linear model at given values, in which nothing is named."""
    problem = replace(problem.with_sweep(sweep), catalogue=CATALOGUE)
    dataset = problem.sweep_dataset(estimate_noise(problem.study.fitted))
    fitter = dataset.fitter_for(Convention())
    fit = fitter.evaluate_values(problem.diagram, values)
    given = Model(problem.diagram, Convention(), fit)
    findings = Findings(dataset.noise, given, given, (), (), (), 1.0, 0, ())
    return problem.answer(findings, dataset)


# --- any kind of data
# ----------------------------------------------------------------------------------------------


def _find_with_noise(problem: _GapProblem, noise: Noise) -> tuple[Findings, SweepDataset] | None:
    """Search a sweep, and again with the residual as the noise where that is not known and differs.

    With a sigma that is too small the data move parameters against the prior, along directions that
    are hardly identifiable; what prevents that seems to be missing. None where the given model has
    no response.
    """
    dataset = problem.sweep_dataset(noise)
    findings = _find_in_dataset(problem, problem.diagram, dataset, ())
    for _ in range(MOST_SEARCHES - 1):
        is_spent = problem.budget.is_exhausted()
        if findings is None or not findings.noise_disagrees or is_spent:
            break
        noise = findings.noise.scaled(findings.scale)
        step = f"the noise is not known: begun again with {noise.level:.2g} of |Y|"
        dataset = problem.sweep_dataset(noise)
        findings = _find_in_dataset(problem, problem.diagram, dataset, (step,))
    return None if findings is None else (findings, dataset)


def _find_in_dataset(
    problem: _GapProblem, diagram: Diagram, data: Dataset, steps: Sequence[str]
) -> Findings | None:
    """Fit, repair and validate a model on one dataset; None where it has no response."""
    problem = replace(problem, diagram=diagram)
    given = _fit_given(problem, data)
    if given is None:
        return None
    return _repair_and_validate(_rank_first_trials(problem, data, given, steps))


def _fit_given(problem: _GapProblem, data: Dataset) -> Model | None:
    """Fit the given model; None where it has no response."""
    problem.progress.begin_stage(0.1)
    problem.progress(0, 1, "the given model refitted")
    return data.fit_given(problem.diagram)


@dataclass(frozen=True, eq=False)
class _FirstTrials:
    """The refitted given model and the trials of its edits, lowest BIC first."""

    state: RepairState
    given: Model
    trials: list[Model]

    @property
    def leading(self) -> list[Model]:
        """The given model, and the trial of lowest cost."""
        return [self.given, *sorted(self.trials, key=lambda trial: trial.refit.cost)[:1]]


def _rank_first_trials(
    problem: _GapProblem, data: Dataset, given: Model, steps: Sequence[str] = ()
) -> _FirstTrials:
    """Fit every edit of the given model."""
    state = RepairState(data, problem.progress, [*data.remarks, *steps])
    state.steps.append(
        f"refitted the given model: chi2 {given.refit.chi2:.4g} of {given.refit.dof:.4g} expected"
    )
    if not isinstance(data, AmplitudeDataset):
        state.so_far = partial(_report_so_far, problem, state)
    problem.progress.begin_stage(0.4)
    return _FirstTrials(state, *rank_first_trials(state, given))


def _repair_and_validate(first: _FirstTrials) -> Findings:
    """Select the edits that repair a model, and validate them on data they were not fitted to.

    The scale of an unknown noise is estimated from the best fits, and, where no edit explains the
    data, from the port map, too.
    """
    state = first.state
    given = first.given
    data = state.dataset
    noise = data.noise
    fits = [given, *first.trials]
    state.progress.begin_stage(0.6)
    state.scale = estimate_noise_scale(noise, fits)
    is_explained = any(explains_data(fit, noise, state.scale) for fit in fits)
    explained = None
    if not is_explained:
        explained = explain_with_other_delays(state, given, first.trials)
    if not (noise.known or is_explained or explained is not None):
        state.ports = _compute_port_map(state, given)
        state.scale = _estimate_scale(state, noise, fits)
    trials = rank_by_bic(first.trials, state.scale)
    best, rivals = repair(state, given, trials, explained)
    if not explains_data(best, data.noise, state.scale):
        nominal_fit = data.fall_back_to_nominal_noise()
        if nominal_fit is not None:
            state.steps.append(
                "what is left is within what sampling leaves open as nominal values tell it: "
                "nothing is named"
            )
            return _validate(state, nominal_fit, [], nominal_fit, [])
    return _validate(state, given, trials, best, rivals)


def _validate(
    state: RepairState, given: Model, trials: list[Model], best: Model, rivals: list[list[Model]]
) -> Findings:
    """Drop a repair that predicts held-out data worse than the given model, and collect findings.

    Parameters
    ----------
    best, rivals
        The repaired model and the competitors of its edits, as `repair` returns them.
    """
    data = state.dataset
    noise = data.noise
    before = None
    after = None
    if best is not given:
        best = data.refit_from_prior(best)
    if best is not given:
        before = data.cross_validate(given)
        after = data.cross_validate(best)
    points = len(noise.sweep.points)
    if before is not None and after is not None and not predicts_no_worse(before, after, points):
        state.steps.append(
            "the repair predicts data that it was not fitted to worse than the given model: dropped"
        )
        best = given
        after = None
        rivals = []
    if not state.ports:
        repaired = best if explains_data(best, noise, state.scale) else None
        state.ports = _compute_port_map(state, given, repaired)
    state.scale = _estimate_scale(state, noise, [given, best, *trials])
    return Findings(
        noise=noise,
        given=given,
        best=best,
        rivals=tuple(map(tuple, rivals)),
        trials=tuple(trials),
        ports=state.ports,
        scale=state.scale,
        tests=state.tests,
        steps=tuple(state.steps),
        before=before,
        after=after,
    )


def _estimate_scale(state: RepairState, noise: Noise, models: Sequence[Model]) -> float:
    """Estimate the factor on the noise from models and from the port map."""
    return estimate_noise_scale(noise, models, [fit.chi2_per_dof for fit in state.ports])


def _compute_port_map(
    state: RepairState, given: Model, repaired: Model | None = None
) -> tuple[PortFit, ...]:
    """Compute the port map of a model that is not adequate; () of another.

    repaired : a model that explains the data, whose values the fits begin with.
    """
    if given.is_adequate():
        return ()
    if repaired is None and state.dataset.budget.is_exhausted():
        state.steps.append("no port map: the effort was spent")
        return ()
    state.progress.begin_stage(0.5)
    state.progress(0, 1, "the port map")
    return state.dataset.compute_port_map(given, state.steps, repaired)


def _report_so_far(
    problem: _GapProblem, state: RepairState, given: Model, best: Model, trials: Sequence[Model]
) -> None:
    """Report the answer as it is now; its experiments are not counted."""

    def build_result() -> Gap:
        findings = Findings(
            noise=state.dataset.noise,
            given=given,
            best=best,
            rivals=(),
            trials=tuple(trials),
            ports=(),
            scale=state.scale,
            tests=state.tests,
            steps=tuple(state.steps),
            complete=False,
        )
        with problem.budget.without_counting():
            gap = problem.answer(findings, state.dataset)
        return replace(
            gap,
            sentence=f"So far: {gap.sentence}",
            experiments=problem.budget.made,
            complete=False,
        )

    problem.progress.report_result(build_result)
