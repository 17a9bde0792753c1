"""find_gap(model, sweep): refit, locate, name, repair, verify; and refuse where the data do not
carry an answer.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Unpack

from ibrid.border import takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit import kernel
from ibrid.gap.amplitudes.amplitudes import Amplitudes
from ibrid.gap.amplitudes.nonlinear_data import AmplitudeData, amplitude_data
from ibrid.gap.answers.amplitude_answer import Nonlinear, alone, beside, unnamed
from ibrid.gap.answers.answer import answer_of
from ibrid.gap.answers.event_answer import event_answer
from ibrid.gap.answers.result import AmplitudeAnswer, Gap
from ibrid.gap.answers.suggesting import Suggest, low_order_blocks
from ibrid.gap.answers.verdict import Findings, missed, verdict_of
from ibrid.gap.answers.watching import Watch
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.recordings.event_question import NO_REST, Asked, asked
from ibrid.gap.recordings.records import Records
from ibrid.gap.refitting.held_out import predicts
from ibrid.gap.refitting.model import Model, Values, best_first, fits, scale_of
from ibrid.gap.refitting.noise import Noise, noise_of
from ibrid.gap.refitting.prior import Nominal, Prior, prior_of, values_of
from ibrid.gap.repair import Bench, explained_in_another_form, first_trials, looked_back, repair
from ibrid.gap.trials.budget import Budget
from ibrid.gap.trials.data import Data
from ibrid.gap.trials.trial import TRIAL_DRAWS, Workshop
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

#: Times at most that everything is tried, each time with the noise that the time before left over.
PASSES = 3
#: Fewest frequencies of every operating point from which a small-signal answer can be had beside
#: several amplitudes.
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
    """Where a model and a measurement disagree, which physical effect is missing, and the model
    with it.

    Parameters
    ----------
    diagram : the model that is believed in; of a record, its fitted values are the nominal ones.
    sweep : the measured
        device, or a study of it; with several injection amplitudes the response is tested for
        linearity first, and a current limit or a dead zone is looked for where it fails.
    values : nominal values, name -> value or {"value", "tolerance"}; they hold the refit as a prior
    (one standard
        deviation of the logarithm: 0.25 for the plant, ln 2 for everything else).
    holdout_op, vocabulary, seed, port, labels : as of `ibrid.study.Study`, but that labels are
    uncertain unless it is said
        here that they are exact; held-out points are predicted before and after. A gap is sought
        with shared parameters and the exact equilibrium alone.
    catalogue : effects that may be missing, also `(*CATALOGUE, MINE)`; `CATALOGUE` when not given.
    suggest : who is asked for edits where something is located in a sweep that the catalogue does
    not know.
    progress : where a line says what is going on: "interactive" (a terminal or a notebook),
        "auto", "terminal", "plain", "notebook", "silent"; or who is told
        (words, share).
    effort : "low", "normal" or "high": experiments after which nothing new is tried
    (`ibrid.gap.trials.budget.EXPERIMENTS`); the
        answer is then the best so far, `complete` is False, and it excludes nothing.
    so_far : is given the answer so far every 10 s.
    events : records in time, fitted together with the sweep, or alone where that is None; limits
    and protections are
        looked for, too, and `holdout_op` may name records.

    Returns
    -------
    Gap with one of six verdicts: no-gap, parameters-only, named, located-unnamed, unexplained,
    data-convention.

    Raises
    ------
    IbridError : an illegal model, a name that it lacks, an operating point that the sweep lacks, or
    no fit at all.
    """
    effects = CATALOGUE if catalogue is None else tuple(catalogue)
    if events is not None:
        return _of_events(
            asked(diagram, sweep, values, events, options), effects, progress, effort, so_far
        )
    if isinstance(sweep, Study) and sweep.events is not None:
        raise IbridError("a study of records alone has no admittances; give its records as events")
    if isinstance(diagram, Record):
        diagram, values = diagram.diagram, values or values_of(diagram)
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
    prior = prior_of(values or {}, wiring, parameter_table(wiring, "exact"))
    gate = linearity(study.fitted)
    budget = Budget(effort)
    with telling(progress) as tell:
        ask = _Question(
            diagram, study, values, prior, effects, suggest, Watch(tell, so_far), budget
        )
        gap = _answered(ask) if gate is None else _answered_at_amplitudes(ask, gate)
    return replace(gap, **budget.account(gap.sentence))


def _of_events(
    question: Asked,
    catalogue: tuple[Effect, ...],
    progress: str | Tell,
    effort: str,
    so_far: Callable[[Gap], None] | None,
) -> Gap:
    """The answer where there are records in time."""
    kernel.load()
    budget = Budget(effort)
    with telling(progress) as tell:
        watch = Watch(tell, so_far)
        ask, data = _reading(question, catalogue, watch, budget)
        given, first = _given(ask, data), None
        if given is not None and question.in_fixed_steps is not None:
            stepped_ask, stepped_data = _reading(question.in_fixed_steps, catalogue, watch, budget)
            is_stepped, (given,) = stepped_data.answers_better([given], data)
            if not is_stepped:
                first = _first_tried(ask, data, given)
                is_stepped, _ = stepped_data.answers_better(first.leading, data)
            if is_stepped:
                ask, data = stepped_ask, stepped_data
                given, first = _given(ask, data), None
        if given is None:
            raise IbridError(NO_REST)
        found = _doubted(ask, data, _all_tried(ask, first or _first_tried(ask, data, given)))
    gap = ask.answer(found, data)
    return replace(gap, **budget.account(gap.sentence))


def _doubted(ask: "_Question", data: Records, findings: Findings) -> Findings:
    """Findings, or what explains the records as far as the answer tells what sampling leaves open,
    where that does not.
    """
    fitter = data.fitter
    if verdict_of(findings) != "named" or not data.doubts(findings.best):
        return findings
    rivals = data.rivals(findings.given, findings.best)
    best = next((one for one in rivals if one.adequate() and data.stable(one)), None)
    if best is None:
        data.reweigh(fitter)
        return findings
    steps = [
        *findings.steps,
        "the answer does not explain the records as far as it tells itself what sampling leaves "
        "open",
    ]
    given = data.as_weighed(findings.given)
    bench = Bench(data, ask.watch, steps, findings.tests)
    return _told(bench, given, rivals, *looked_back(bench, given, best, rivals))


def _reading(
    question: Asked, catalogue: tuple[Effect, ...], watch: Watch, budget: Budget
) -> tuple["_Question", Records]:
    """What is asked of records as they are read, and the data that answer it."""
    prior = question.prior()
    about = (question.diagram, question.study, question.values, prior, catalogue, ())
    return _Question(*about, watch, budget, question), question.records(prior, catalogue, budget)


@dataclass(frozen=True, eq=False)
class _Question:
    """What is asked of a study; of records alone nothing was swept, and there is none.

    `of_events` : where there are records.
    """

    diagram: Diagram
    swept: Study | None
    values: Nominal | None
    prior: Prior
    catalogue: tuple[Effect, ...]
    suggest: Sequence[Suggest]
    watch: Watch
    budget: Budget
    of_events: Asked | None = None

    @property
    def study(self) -> Study:
        """Of the sweeps."""
        assert self.swept is not None, "records alone ask for no sweep"
        return self.swept

    def workshop(self, noise: Noise) -> Workshop:
        """The small-signal sweep at a noise."""
        study = self.study
        return Workshop(
            noise, study.kinds, self.prior, self.catalogue, study.seed, study.labels, self.budget
        )

    def answer(self, findings: Findings, data: Data, suggest: Sequence[Suggest] = ()) -> Gap:
        """The Gap that findings amount to; where the budget was not enough for all, nothing is
        excluded.
        """
        findings = replace(findings, complete=findings.complete and not self.budget.stopped)
        if isinstance(data, Records) and self.of_events is not None:
            return event_answer(findings, data, self.of_events)
        assert isinstance(data, Workshop), (
            "amplitudes are answered by what is nonlinear beside a sweep"
        )
        return answer_of(
            findings, data, self.diagram, self.study.sweep, self.study.held, self.values, suggest
        )


def _answered(ask: _Question) -> Gap:
    """The answer where there is one amplitude."""
    noise = noise_of(ask.study.fitted)
    result = _findings(ask, noise)
    if result is None:
        raise IbridError(
            "the model has no response at these operating points; check p, q, v and the per-unit "
            "base"
        )
    if noise.known and verdict_of(result[0]) == "unexplained" and not ask.budget.over():
        loose = _findings(ask, noise.of_models(missed(result[0].best))) or result
        result = _explained(ask, *result, loose[0].best) or loose
    return ask.answer(*result, () if ask.budget.over() else ask.suggest)


def _explained(
    ask: _Question, told: Findings, shop: Workshop, loose: Model
) -> tuple[Findings, Workshop] | None:
    """What was found at the noise of models, where it fits as well as the noise of the data allows
    after all; else None.
    """
    best = shop.refitted(loose, [loose.refit.values], draws=TRIAL_DRAWS) if loose.edits else None
    if best is None or not fits(best, shop.noise, told.scale):
        return None
    steps = [*told.steps, "the noise of models led to what fits the noise of the data"]
    bench, trials = Bench(shop, ask.watch, steps, told.tests), [*told.trials]
    return _told(bench, told.given, trials, *looked_back(bench, told.given, best, trials)), shop


# --- several amplitudes
# ----------------------------------------------------------------------------------------------


def _answered_at_amplitudes(ask: _Question, gate: Linearity) -> Gap:
    """The answer where there are several amplitudes; gate : of the fitted points.

    Where the response depends on the amplitude by more than products of signals cause, a
    nonlinearity is looked for in all amplitudes together, and the small-signal sweep has the other
    frequencies alone.
    """
    sweep, small = ask.study.sweep, small_signal(ask.study.sweep, gate)
    answer = AmplitudeAnswer(
        gate, 0 if small is None else min(len(point.frequency) for point in small.points)
    )
    if not len(gate.refused) and small is not None:
        gap = _answered(replace(ask, swept=replace(ask.study, sweep=small)))
        return replace(gap, sentence=f"{gap.sentence} {gate.sentence}", amplitude=answer)
    small = small if answer.kept >= FEWEST else None
    data = amplitude_data(ask.study.fitted)
    nonlinear = None if data is None else _nonlinear(ask, ask.diagram, data, answer)
    if nonlinear is not None and nonlinear.best is not None and nonlinear.named:
        gap = _linear(
            ask, at_amplitudes(sweep)[0] if small is None else small, nonlinear.best.values
        )
        all_data, nominal = nonlinear.data, None
        if ask.values:
            nominal = all_data.data.linear_nrmse(
                all_data.refitter.at_values(ask.diagram, {}).responses
            )
        return alone(gap, nonlinear, nominal)
    if small is None:
        gap = _linear(
            ask,
            at_amplitudes(sweep)[0],
            {} if nonlinear is None else nonlinear.found.given.refit.values,
        )
        return unnamed(gap, nonlinear, answer)
    gap = _answered(replace(ask, swept=replace(ask.study, sweep=small)))
    if gap.verdict == "named" and data is not None:
        again = _nonlinear(ask, gap.diagram, data, answer)
        if again is not None and again.named:
            return beside(gap, again)
    return unnamed(gap, nonlinear, answer)


def _nonlinear(
    ask: _Question, diagram: Diagram, data: AmplitudeData, gate: AmplitudeAnswer
) -> Nonlinear | None:
    """What all amplitudes together tell beside a linear model; None where that has no response."""
    amplitudes = Amplitudes(data, ask.study.kinds, ask.prior, ask.study.seed, ask.budget)
    found = _tried(ask, diagram, amplitudes, ())
    return None if found is None else Nonlinear(found, amplitudes, gate)


def _linear(ask: _Question, sweep: Sweep, values: Values) -> Gap:
    """The linear model at given values as an answer that names nothing."""
    ask = replace(ask, catalogue=CATALOGUE, swept=replace(ask.study, sweep=sweep))
    shop = ask.workshop(noise_of(ask.study.fitted))
    given = Model(
        ask.diagram, Convention(), shop.refitter(Convention()).at_values(ask.diagram, values)
    )
    found = Findings(shop.noise, given, given, (), (), (), 1.0, 0, ())
    return ask.answer(found, shop)


# --- any kind of data
# ----------------------------------------------------------------------------------------------


def _findings(ask: _Question, noise: Noise) -> tuple[Findings, Workshop] | None:
    """Everything tried; again with what is left over as the noise, where that is not known and not
    what was assumed.

    A sigma that is too small lets the data pull parameters where no prior would have them, along
    directions that the data hardly see; whatever stops that seems to be missing. None where the
    given model has no response.
    """
    shop = ask.workshop(noise)
    findings = _tried(ask, ask.diagram, shop, ())
    for _ in range(PASSES - 1):
        if findings is None or not findings.weighed_wrongly or ask.budget.over():
            break
        noise = findings.noise.times(findings.scale)
        shop, again = (
            ask.workshop(noise),
            f"the noise is not known: begun again with {noise.level:.2g} of |Y|",
        )
        findings = _tried(ask, ask.diagram, shop, (again,))
    return None if findings is None else (findings, shop)


@dataclass(frozen=True, eq=False)
class _First:
    """The given model, refitted, and the first trials of it."""

    bench: Bench
    given: Model
    trials: list[Model]

    @property
    def leading(self) -> list[Model]:
        """The given model, and the trial that fits best."""
        return [self.given, *sorted(self.trials, key=lambda one: one.refit.cost)[:1]]


def _tried(ask: _Question, diagram: Diagram, data: Data, steps: Sequence[str]) -> Findings | None:
    """Everything tried; None where the given model has no response."""
    ask = replace(ask, diagram=diagram)
    given = _given(ask, data)
    return None if given is None else _all_tried(ask, _first_tried(ask, data, given, steps))


def _given(ask: _Question, data: Data) -> Model | None:
    """The given model refitted; None where it has no response."""
    ask.watch.stage(0.1)
    ask.watch(0, 1, "the given model refitted")
    return data.given(ask.diagram)


def _first_tried(ask: _Question, data: Data, given: Model, steps: Sequence[str] = ()) -> _First:
    bench = Bench(data, ask.watch, [*data.remarks, *steps])
    bench.steps.append(
        f"refitted the given model: chi2 {given.refit.chi2:.4g} of {given.refit.dof:.4g} expected"
    )
    if not isinstance(data, Amplitudes):
        bench.so_far = partial(_so_far, ask, bench)
    ask.watch.stage(0.4)
    return _First(bench, *first_trials(bench, given))


def _all_tried(ask: _Question, first: _First) -> Findings:
    bench, given, trials = first.bench, first.given, first.trials
    data, noise = bench.shop, bench.shop.noise
    ask.watch.stage(0.6)
    bench.scale = scale_of(noise, [given, *trials])
    explaining = any(fits(one, noise, bench.scale) for one in [given, *trials])
    explained = None if explaining else explained_in_another_form(bench, given, trials)
    if not (noise.known or explaining or explained is not None):
        bench.ports = _ports(bench, given)  # a single place may tell how large the noise is
        bench.scale = scale_of(noise, [given, *trials], [one.chi2_per_dof for one in bench.ports])
    trials = best_first(trials, bench.scale)
    best, rivals = repair(bench, given, trials, explained)
    if not fits(best, data.noise, bench.scale) and (rough := data.roughly()) is not None:
        bench.steps.append(
            "what is left is within what sampling leaves open as nominal values tell it: nothing "
            "is named"
        )
        given, best, trials, rivals = rough, rough, [], []
    return _told(bench, given, trials, best, rivals)


def _told(
    bench: Bench, given: Model, trials: list[Model], best: Model, rivals: list[list[Model]]
) -> Findings:
    """What a repair found, where it predicts what it was not fitted to."""
    data, noise = bench.shop, bench.shop.noise
    best = best if best is given else data.begun_from_beliefs(best)
    before, after = (
        (data.held_out(given), data.held_out(best)) if best is not given else (None, None)
    )
    if (
        before is not None
        and after is not None
        and not predicts(before, after, len(noise.sweep.points))
    ):
        bench.steps.append(
            "the repair predicts data that it was not fitted to worse than the given model: dropped"
        )
        best, after, rivals = given, None, []
    bench.ports = bench.ports or _ports(
        bench, given, best if fits(best, noise, bench.scale) else None
    )
    bench.scale = scale_of(noise, [given, best, *trials], [one.chi2_per_dof for one in bench.ports])
    told = (tuple(trials), bench.ports, bench.scale, bench.tests, tuple(bench.steps), before, after)
    return Findings(noise, given, best, tuple(map(tuple, rivals)), *told)


def _ports(bench: Bench, given: Model, repaired: Model | None = None) -> tuple[PortFit, ...]:
    """The port map of a model that is not adequate."""
    if given.adequate():
        return ()
    if repaired is None and bench.shop.budget.over():
        bench.steps.append("no port map: the effort was spent")
        return ()
    bench.watch.stage(0.5)
    bench.watch(0, 1, "the port map")
    return bench.shop.ports(given, bench.steps, repaired)


def _so_far(
    ask: _Question, bench: Bench, given: Model, best: Model, trials: Sequence[Model]
) -> None:
    """Pass on what would be answered now."""

    def answer() -> Gap:
        noise, steps = bench.shop.noise, tuple(bench.steps)
        findings = Findings(
            noise,
            given,
            best,
            (),
            tuple(trials),
            (),
            bench.scale,
            bench.tests,
            steps,
            complete=False,
        )
        with ask.budget.aside():
            gap = ask.answer(findings, bench.shop)
        return replace(
            gap, sentence=f"So far: {gap.sentence}", experiments=ask.budget.made, complete=False
        )

    ask.watch.so_far(answer)
