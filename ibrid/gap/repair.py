"""The repair of a model by stepwise selection of edits.

Every edit is fitted and the best is kept, until none is significant (forward selection); then edits
that are not needed are left out (backward elimination). Where no single edit explains the data,
combinations are searched with a beam.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ibrid.evaluation.grade import CLOSE as CLOSE_TO_NOISE
from ibrid.evaluation.reading import is_usual
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.gap.datasets.dataset import Dataset
from ibrid.gap.delay_forms import fit_other_delay_forms
from ibrid.gap.edit_removal import drop_lost_forms, refit_without_edit
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.progress import ProgressReporter
from ibrid.gap.refitting.model import (
    Model,
    estimate_noise_scale,
    explains_data,
    explains_nearly_all,
    is_delay_form,
    is_significant,
    rank_by_bic,
    removes_implausible_parameter,
)
from ibrid.measurement.conventions.labels import Convention
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.network.outside import LABEL

#: Of each edit of a model, the models that compete for its place.
Rivals = list[list[Model]]
#: Edits at most; the form in which the device has its delays does not count.
MOST_EDITS = 3
#: The same where a fit takes long and single edits do not explain: each step takes a minute.
MOST_SLOW_EDITS = 2
#: Combinations that are refitted in a step, and models from which the next step begins.
MOST_REFITS = 8
BEAM_WIDTH = 4
#: First edits that are combined with other conventions and forms of delays.
COMBINED_EDITS = 3
#: Rounds in which an edit of an insufficient repair is exchanged for another.
EXCHANGE_ROUNDS = 2
#: Exchanges refitted when no other helps: edits with more parameters that screening leaves worse.
MOST_MISSED = 24
#: Edits refitted in the order of screening; BIC behind the best up to which more are; and how many
#: when one of them explains the data.
REFITTED = 12
CLOSE_BIC = 30.0
REFITTED_WHEN_EXPLAINED = 6
#: The same where the model explains the data already, and screening is nearly a refit.
REFITTED_NEAR = 4
CLOSE_BIC_NEAR = 6.0
#: Gain in cost below which an edit of such a model is not refitted.
IDLE_GAIN = 1.0
#: Part of the cost by which residuals of two trials differ at least: below the first they are
#: equivalent, below the second the later one waits until others have had their turn.
EQUIVALENT = 1e-4
SIMILAR = 0.1
#: Best trials whose values the model before is refitted from.
RESTARTS = 3
#: Gain in cost that makes such a refit a better minimum.
BETTER_COST = 1.0


@dataclass
class RepairState:
    """What a repair works with, and what it has done so far.

    Parameters
    ----------
    dataset : Dataset
        The measured data, which fit and screen models.
    progress : ProgressReporter
        Is told what is being tried.
    steps : list of str
        What was decided, in order.
    tests : int
        Hypotheses tested, for the significance level of each.
    scale : float
        Factor on the standard deviation of the noise.
    ports : tuple of PortFit
        The port map, () where none was computed.
    so_far : Callable
        Is given the given model, the best one and the trials after each step.
    """

    dataset: Dataset
    progress: ProgressReporter = field(default_factory=ProgressReporter)
    steps: list[str] = field(default_factory=list)
    tests: int = 0
    scale: float = 1.0
    ports: tuple[PortFit, ...] = ()
    so_far: Callable[[Model, Model, Sequence[Model]], None] = lambda given, best, trials: None


# --- trials of a model
# ----------------------------------------------------------------------------------------------


def rank_trials(state: RepairState, model: Model, *, conventions: bool) -> list[Model]:
    """Fit every edit of a model and return the trials, lowest BIC first.

    Screening fits rank all edits; the first ones, and those with a BIC near the best refit, are
    refitted. The others stay as screening left them.

    Parameters
    ----------
    conventions : bool
        Also read the data in other conventions.
    """
    dataset = state.dataset
    explained = is_explained(state, model)
    screened = screen_edits(state, model, near=explained)
    quick_values = (model.refit.values,) if explained else ()
    most, close_bic = (REFITTED_NEAR, CLOSE_BIC_NEAR) if explained else (REFITTED, CLOSE_BIC)
    idle_cost = model.cost(state.scale) - IDLE_GAIN
    lowest_bic = np.inf
    trials: list[Model] = []
    for number, screening_fit in enumerate(screened):
        edit = screening_fit.edits[-1]
        adds_no_parameter = screening_fit.parameter_count >= model.parameter_count
        idle = explained and adds_no_parameter and screening_fit.cost(state.scale) > idle_cost
        hopeless = idle or screening_fit.bic(state.scale) > lowest_bic + close_bic
        skipped = number >= most and hopeless
        if skipped or isinstance(edit, Convention) or dataset.budget.is_exhausted():
            trials.append(screening_fit)
            continue
        description = f"{edit.effect}: {edit.change} {edit.where}"
        state.progress(min(number, most), most, description)
        refit = dataset.fit_edit(model, edit, quick=quick_values) or screening_fit
        trial = min(refit, screening_fit, key=lambda fit: fit.refit.cost)
        trials.append(trial)
        lowest_bic = min(lowest_bic, trial.bic(state.scale))
        if is_explained(state, trial):
            most = min(most, REFITTED_WHEN_EXPLAINED)
    if conventions:
        adequate_costs = [trial.refit.cost for trial in trials if trial.is_adequate(state.scale)]
        trials += fit_other_conventions(state, model, min(adequate_costs, default=np.inf))
    state.tests += len(trials)
    return rank_by_bic(trials, state.scale)


def screen_edits(state: RepairState, model: Model, *, near: bool = False) -> list[Model]:
    """Screen every edit of a model by a few fitting steps and rank the results by BIC.

    near : the model explains the data, so that only its own values are started from.
    """
    edits = state.dataset.insertions(model)
    screened = []
    for edit in edits:
        if state.dataset.budget.is_exhausted():
            break
        description = f"screening {edit.effect}: {edit.change} {edit.where}"
        state.progress(0, len(edits), description)
        screened.append(state.dataset.screen_edit(model, edit, near=near))
    return rank_by_bic((fit for fit in screened if fit is not None), state.scale)


def fit_other_conventions(state: RepairState, model: Model, reached_cost: float) -> list[Model]:
    """Fit a model to the data read in other conventions; [] where it reads them so already.

    reached_cost : cost that another trial reaches; conventions far above it are not fitted.
    """
    if model.convention != Convention() or state.dataset.budget.is_exhausted():
        return []
    state.progress(REFITTED, REFITTED, "other conventions of the data")
    fits = state.dataset.fit_other_conventions(model, reached_cost)
    return [fit for fit in fits if improves_every_point(model, fit)]


def improves_every_point(before: Model, after: Model) -> bool:
    """Whether the whitened residual falls at every operating point, as a right convention does."""
    pairs = zip(before.refit.residuals, after.refit.residuals, strict=True)
    return all((np.abs(new) ** 2).sum() < (np.abs(old) ** 2).sum() for old, new in pairs)


def refit_from_trials(state: RepairState, model: Model, trials: list[Model]) -> Model:
    """Refit a model from the values of its best trials, and return the better fit.

    A local minimum that was missed looks like a missing effect.
    """
    leading = [trial for trial in trials[:RESTARTS] if trial.convention == model.convention]
    if not leading:
        return model
    refitted = state.dataset.refit_from(model, [trial.refit.values for trial in leading])
    if refitted.refit.cost < model.refit.cost - BETTER_COST:
        state.steps.append(
            f"dropped back: the model before fits better from there, cost {model.refit.cost:.4g} "
            f"-> {refitted.refit.cost:.4g}"
        )
    return refitted


def rank_first_trials(state: RepairState, given: Model) -> tuple[Model, list[Model]]:
    """Rank the trials of the given model, and refit that from them.

    Returns
    -------
    tuple of Model and list of Model
        The given model at the best minimum found, and its trials.
    """
    trials = rank_trials(state, given, conventions=not given.is_adequate(state.scale))
    for _ in range(2):
        refitted = refit_from_trials(state, given, trials)
        if refitted.refit.cost >= given.refit.cost - BETTER_COST:
            return refitted, trials
        given = refitted
        if given.is_adequate(state.scale):
            # nothing may be missing: compare all edits with the better minimum
            trials = rank_trials(state, given, conventions=False)
    return given, trials


def explain_with_other_delays(
    state: RepairState, given: Model, trials: list[Model]
) -> Model | None:
    """Find delays in another form that explain the data together with one more edit; else None.

    Done before effects are combined: a wrong form of delay makes several look missing. What is
    missing biases the choice of a form, so that forms are tried with the first edits, then edits
    with the first form.
    """
    first_edits = select_significant(state, given, trials)
    effects = [trial for trial in first_edits if not is_delay_form(trial.edits[-1])]
    combined: list[Model] = []
    for trial in effects[:COMBINED_EDITS]:
        combined += _fit_other_delays(state, trial)
    best = _select_explaining(state, combined)
    if best is not None:
        return best
    forms = [trial for trial in first_edits if is_delay_form(trial.edits[-1])]
    pairs = [(form, screened) for form in forms[:1] for screened in screen_edits(state, form)]
    return _select_explaining(state, _refit_candidates(state, pairs))


def _select_explaining(state: RepairState, models: list[Model]) -> Model | None:
    """Return the stable model of lowest BIC that explains the data; None where none does.

    An unknown noise is estimated from these models, too.
    """
    ranked = rank_by_bic((model for model in models if state.dataset.is_stable(model)), state.scale)
    state.tests += len(models)
    noise = state.dataset.noise
    scale = state.scale
    if ranked and not noise.known:
        scale = min(scale, estimate_noise_scale(noise, ranked))
    for model in ranked:
        if explains_data(model, noise, scale):
            state.scale = scale
            return model
    return None


# --- forward selection, then backward elimination
# ----------------------------------------------------------------------------------------------


def repair(
    state: RepairState, given: Model, trials: list[Model], explained: Model | None = None
) -> tuple[Model, Rivals]:
    """Select edits forward, then eliminate those that are not needed.

    Parameters
    ----------
    given : Model
        The refitted given model, with its `trials`.
    explained : Model or None
        A model that explains the data already, from which selection then begins.

    Returns
    -------
    tuple of Model and list of list of Model
        The repaired model and, for each of its edits, the models that compete for its place.
    """
    if explained is None:
        best = _select_forward(state, given, trials)
    else:
        best = _add_edits(state, explained)
    return eliminate_backward(state, given, best, trials)


def eliminate_backward(
    state: RepairState, given: Model, best: Model, trials: list[Model]
) -> tuple[Model, Rivals]:
    """Leave out edits that are not needed, and exchange one for a clearly better competitor.

    Returns what `repair` returns.
    """
    best = _drop_unneeded_edits(state, given, best)
    rivals = _find_rivals(state, given, best, trials)
    better = _find_better_rival(state, best, rivals)
    if better is None:
        return best, rivals
    state.steps.append(
        f"exchanged: {_describe_edit(better.edits[-1])} explains clearly more in the place of "
        "another edit"
    )
    best = _drop_unneeded_edits(state, given, better)
    return best, _find_rivals(state, given, best, trials)


def _find_better_rival(state: RepairState, best: Model, rivals: Rivals) -> Model | None:
    """Return the best stable competitor of one of several edits with a clearly lower BIC."""
    if len(best.edits) < 2:
        return None
    limit = best.bic(state.scale) - EQUALLY_GOOD.bic
    competitors = [rival for rivals_of_edit in rivals for rival in rivals_of_edit]
    better = [rival for rival in competitors if rival.bic(state.scale) < limit]
    stable = [rival for rival in better if state.dataset.is_stable(rival)]
    return next(iter(rank_by_bic(stable, state.scale)), None)


def is_explained(state: RepairState, model: Model) -> bool:
    """Whether a model fits as well as the noise allows."""
    return explains_data(model, state.dataset.noise, state.scale)


def is_nearly_all_explained(state: RepairState, given: Model, first: Model) -> bool:
    """Whether one edit takes nearly all of the squared misfit away, in data of slow fits."""
    return state.dataset.beam_width < 2 and explains_nearly_all(given, first, state.scale)


def is_close_to_noise(state: RepairState, model: Model) -> bool:
    """Whether too little more than noise is left to look for another effect in it."""
    limit = (1.0 + CLOSE_TO_NOISE**2) * model.refit.dof * state.scale**2
    return bool(model.refit.chi2 <= limit)


def _select_forward(state: RepairState, given: Model, trials: list[Model]) -> Model:
    """Add edits to the given model while they are significant, alone or in combination."""
    first_edits = select_significant(state, given, trials)
    if not first_edits:
        state.so_far(given, given, trials)
        return given
    first = first_edits[0]
    state.so_far(given, first, trials)
    if is_explained(state, first):
        return _add_edits(state, first)
    if is_nearly_all_explained(state, given, first):
        state.steps.append(
            f"{_describe_edit(first.edits[-1])} explains nearly all; no pairs of edits were tried "
            "in its place"
        )
        extended = first if is_close_to_noise(state, first) else _add_edits(state, first)
        return extended if is_explained(state, extended) else first
    best = _search_beam(state, given, first_edits)
    for _ in range(EXCHANGE_ROUNDS if state.dataset.beam_width > 1 else 0):
        if is_explained(state, best) or state.dataset.budget.is_exhausted():
            break
        exchanged = _exchange_edit(state, given, best)
        if exchanged is None:
            break
        best = exchanged
        state.so_far(given, best, trials)
    explained = is_explained(state, best)
    edits = " + ".join(_describe_edit(edit) for edit in best.edits)
    costs = f"cost {given.refit.cost:.4g} -> {best.refit.cost:.4g}"
    state.steps.append(f"tried together: {edits}; {costs}{'' if explained else ', not enough'}")
    return _add_edits(state, best) if explained else best


def _search_beam(state: RepairState, given: Model, first_edits: list[Model]) -> Model:
    """Combine edits step by step, keeping the best few models of each step (beam search).

    A wrong convention hides what is missing, and what is missing hides it: the first significant
    convention is carried along, and the first edits of every step are tried in other conventions.
    """
    width = state.dataset.beam_width
    most_edits = MOST_EDITS if width > 1 else MOST_SLOW_EDITS
    beam = _select_distinct(first_edits, width)
    if width > 1:
        beam += [
            trial
            for trial in first_edits
            if isinstance(trial.edits[-1], Insertion)
            and removes_implausible_parameter(given, trial)
        ]
    beam += [trial for trial in first_edits if isinstance(trial.edits[-1], Convention)][:1]
    beam = _add_other_readings(state, [*dict.fromkeys(beam)], COMBINED_EDITS)
    best = rank_by_bic((first_edits[0], beam[0]), state.scale)[0]
    while not is_explained(state, best) and not state.dataset.budget.is_exhausted():
        beam = [model for model in beam if model.effect_count < most_edits]
        pairs = [(model, screened) for model in beam for screened in screen_edits(state, model)]
        refitted = _refit_candidates(state, pairs)
        beam = _add_other_readings(state, _select_distinct(refitted, min(BEAM_WIDTH, width)), 1)
        if not beam or beam[0].bic(state.scale) >= best.bic(state.scale):
            break
        best = beam[0]
        state.so_far(given, best, first_edits)
    return best


def _add_other_readings(state: RepairState, beam: list[Model], number: int) -> list[Model]:
    """Add the best other convention or form of delays of the first models; lowest BIC first.

    Only the usual mistakes in conventions: a free scale takes up a part of whatever is missing.
    """
    models = list(beam)
    for model in beam[:number]:
        if model.effect_count >= MOST_EDITS or is_explained(state, model):
            continue
        readings = fit_other_conventions(state, model, np.inf)
        trials = [
            reading
            for reading in readings
            if isinstance(reading.edits[-1], Convention) and is_usual(reading.edits[-1])
        ]
        trials += _fit_other_delays(state, model)
        state.tests += len(trials)
        accepted = select_significant(state, model, trials)
        models += rank_by_bic(accepted, state.scale)[:1]
    return rank_by_bic(models, state.scale)


def _fit_other_delays(state: RepairState, model: Model) -> list[Model]:
    """Fit a model with its delays in other forms; [] where it has one already or fits are slow."""
    if state.dataset.beam_width < 2 or any(map(is_delay_form, model.edits)):
        return []
    return fit_other_delay_forms(state.dataset, model, state.scale)


def _exchange_edit(state: RepairState, given: Model, best: Model) -> Model | None:
    """Return the best exchange of one edit for another; None where none has a lower BIC."""
    pairs: list[tuple[Model, Model]] = []
    for place, edit in enumerate(best.edits):
        if isinstance(edit, Convention):
            continue
        remainder = refit_without_edit(state.dataset, given, best, place)
        if remainder is not None and not state.dataset.budget.is_exhausted():
            pairs += [(remainder, screened) for screened in screen_edits(state, remainder)]
    missed = [
        (remainder, screened)
        for remainder, screened in pairs
        if screened.parameter_count > remainder.parameter_count
        and screened.cost() > remainder.cost()
    ]
    for candidates, most in ((pairs, MOST_REFITS), (missed, MOST_MISSED)):
        exchanged = next(iter(_refit_candidates(state, candidates, most)), best)
        if exchanged.bic(state.scale) < best.bic(state.scale) - EQUALLY_GOOD.bic:
            return exchanged
    return None


def _refit_candidates(
    state: RepairState, pairs: list[tuple[Model, Model]], most: int = MOST_REFITS
) -> list[Model]:
    """Refit the best screening fits and return the accepted ones, lowest BIC first.

    Parameters
    ----------
    pairs : list of tuple
        A model, and the screening fit of one of its edits.
    most : int
        Refits at most. Equivalent screening fits are refitted once; no first edit takes more than
        half of the refits where there are several.
    """
    state.tests += len(pairs)
    accepted: list[Model] = []
    chosen: list[Model] = []
    chosen_by_first = dict.fromkeys((_first_effect(before) for before, _ in pairs), 0)
    most_by_first = most // min(2, max(1, len(chosen_by_first)))
    for before, screened in sorted(pairs, key=lambda pair: pair[1].bic(state.scale)):
        if len(chosen) >= most or state.dataset.budget.is_exhausted():
            break
        cost = screened.cost()
        is_twin = any(abs(cost - other.cost()) <= EQUIVALENT * other.cost() for other in chosen)
        if is_twin or chosen_by_first[_first_effect(before)] >= most_by_first:
            continue
        chosen.append(screened)
        chosen_by_first[_first_effect(before)] += 1
        edit = screened.edits[-1]
        if isinstance(edit, Convention):
            continue
        state.progress(len(chosen), most, f"together with {_describe_edit(edit)}")
        refit = state.dataset.fit_edit(before, edit) or screened
        model = min(refit, screened, key=lambda trial: trial.refit.cost)
        if _is_accepted(state, before, model, state.tests):
            accepted.append(model)
    noise = state.dataset.noise
    if accepted and not noise.known:
        by_cost = sorted(accepted, key=lambda model: model.refit.cost)
        state.scale = min(state.scale, estimate_noise_scale(noise, by_cost))
    return rank_by_bic(accepted, state.scale)


def _select_distinct(models: list[Model], number: int) -> list[Model]:
    """Select models with different residuals and first edits, in their order.

    A delay, a hold and a late current act nearly alike, and combinations with the best first edit
    would fill a beam alone: similar ones are taken only where places are left, equivalent ones
    never.
    """
    chosen: list[Model] = []
    for least_difference, most_by_first in ((SIMILAR, BEAM_WIDTH // 2), (EQUIVALENT, number)):
        for model in models:
            same_first = [other for other in chosen if _first_effect(other) == _first_effect(model)]
            is_common = len(model.edits) > 1 and len(same_first) >= most_by_first
            is_distinct = all(
                _residual_distance(model, other) > least_difference * other.refit.cost
                for other in chosen
            )
            if is_distinct and not is_common and len(chosen) < number:
                chosen.append(model)
    return chosen


def _residual_distance(first: Model, second: Model) -> float:
    """Return sum |e_1 - e_2|^2 of the whitened residuals of two models."""
    pairs = zip(first.refit.residuals, second.refit.residuals, strict=True)
    return sum((np.abs(residual - other) ** 2).sum() for residual, other in pairs)


def _first_effect(model: Model) -> str:
    """Return the effect of the first edit; "" without edits."""
    return getattr(model.edits[0], "effect", LABEL) if model.edits else ""


def select_significant(state: RepairState, before: Model, trials: list[Model]) -> list[Model]:
    """Select the trials that are significant and stable, in their order."""
    return [trial for trial in trials if _is_accepted(state, before, trial, len(trials))]


def _is_accepted(state: RepairState, before: Model, after: Model, tests: int) -> bool:
    """Whether an edit, one of so many tests, is significant and leaves a stable model."""
    return (
        is_significant(before, after, tests, state.scale)
        and state.dataset.accepts_edit(before, after)
        and state.dataset.is_stable(after)
    )


def _add_edits(state: RepairState, model: Model) -> Model:
    """Add the best edit again and again, while it is significant and clearly lowers the BIC."""
    while model.effect_count < MOST_EDITS and not state.dataset.budget.is_exhausted():
        trials = rank_trials(state, model, conventions=False)
        model = refit_from_trials(state, model, trials)
        accepted = select_significant(state, model, trials)
        if not accepted:
            return model
        limit = model.bic(state.scale) - EQUALLY_GOOD.bic
        if is_explained(state, model) and accepted[0].bic(state.scale) > limit:
            return model
        model = accepted[0]
    return model


def _drop_unneeded_edits(state: RepairState, given: Model, best: Model) -> Model:
    """Leave out, one by one, each edit without which the others do as well.

    Forms of delays that a later edit removed go first.
    """
    best = drop_lost_forms(state.dataset, given, best)
    place = 0
    while len(best.edits) > max(1, place) and not state.dataset.budget.is_exhausted():
        edit = best.edits[place]
        remainder = refit_without_edit(state.dataset, given, best, place)
        if (
            remainder is None
            or not state.dataset.is_stable(remainder)
            or _is_needed(state, edit, remainder, best)
        ):
            place += 1
            continue
        state.steps.append(f"looked back: {_describe_edit(edit)} is not needed beside the rest")
        best = remainder
        place = 0
    return best


def _is_needed(
    state: RepairState, edit: Insertion | Convention, remainder: Model, best: Model
) -> bool:
    """Whether an edit is significant in addition to the others, and would be tried with them."""
    needed = is_significant(remainder, best, state.tests, state.scale)
    return needed and state.dataset.would_try_edit(remainder, edit)


def _find_rivals(state: RepairState, given: Model, best: Model, trials: list[Model]) -> Rivals:
    """Return, for each edit of a model, what else could stand in its place beside the others.

    Effects by screening, the first of them by a quick refit from its values and those of the
    model; conventions by other conventions.
    """
    if len(best.edits) < 2:
        return [trials] * len(best.edits)
    is_slow = state.dataset.beam_width < 2
    if state.dataset.budget.is_exhausted() or (is_slow and not is_explained(state, best)):
        return [[] for _ in best.edits]  # nothing is named of it
    rivals: Rivals = []
    for place, edit in enumerate(best.edits):
        remainder = refit_without_edit(state.dataset, given, best, place)
        if remainder is None:
            rivals.append([])
        elif isinstance(edit, Convention):
            rivals.append(fit_other_conventions(state, remainder, best.refit.cost))
        else:
            screened = screen_edits(state, remainder)
            values = (best.refit.values, remainder.refit.values)
            edits = [fit.edits[-1] for fit in screened[:MOST_REFITS]]
            refits = [
                state.dataset.fit_edit(remainder, other, quick=values)
                for other in edits
                if isinstance(other, Insertion)
            ]
            fitted = [refit for refit in refits if refit is not None]
            rivals.append([*fitted, *screened[MOST_REFITS:]])
    return rivals


def _describe_edit(edit: Insertion | Convention) -> str:
    """Describe an edit in the list of steps."""
    if isinstance(edit, Convention):
        return edit.words
    return f"{edit.effect} ({edit.change} {edit.where})"
