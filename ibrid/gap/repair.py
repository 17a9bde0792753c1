"""The repair of a model, edit by edit: try everything, keep what pays most, look back, go on until
nothing pays.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ibrid.evaluation.adequacy import EQUALLY_GOOD
from ibrid.evaluation.grade import CLOSE as CLOSE_TO_NOISE
from ibrid.evaluation.reading import is_usual
from ibrid.gap.answers.watching import Watch
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.refitting.model import (
    Model,
    best_first,
    driven_to_nothing,
    explains_nearly_all,
    fits,
    is_form,
    scale_of,
    significant,
)
from ibrid.gap.trials.data import Data
from ibrid.gap.trials.delay_forms import in_other_forms
from ibrid.gap.trials.leaving_out import without, without_lost_forms
from ibrid.measurement.conventions.labels import Convention
from ibrid.parts.editing.practice import Insertion
from ibrid.structure.network.outside import LABEL

#: Edits at most; in which form the device has its delays is none of them.
MOST_EDITS = 3
#: The same in data whose fits take long, where they do not explain: each further step takes a
#: minute.
MOST_SLOW = 2
#: Where no single edit is enough: edits of a step that are refitted; models from which the next
#: step is looked at.
CARRIED, BEAM = 8, 4
#: First edits beside which labels and forms of delays are doubted.
LABELLED = 3
#: Rounds at most in which each edit of an answer that is not enough is exchanged for another; of
#: edits with more free numbers that a glance leaves worse, so many are refitted when no other
#: exchange pays.
SWAPS, MISSED = 2, 24
#: Edits that are refitted, in the order of a glance, the distance in the information criterion up
#: to which more are, and how many when one of them fits as well as the noise allows.
REFITTED, CLOSE, SETTLED = 12, 30.0, 6
#: The same where the model fits already: only what pays well beside it counts, and a glance from
#: there is nearly a refit; what it finds to gain less than this stays as it is.
FURTHER, NEARLY, IDLE = 4, 6.0, 1.0
#: Part of the cost by which two trials must differ, or they say the same of the data; part by which
#: what two models leave must differ, or the second waits until others have had their turn.
APART, SPREAD = 1e-4, 0.1
#: Of the best trials: those from which the model before is refitted (drop-back).
LOOKED_BACK = 3
#: Gain in cost that makes a model before worth starting over.
BETTER = 1.0


@dataclass
class Bench:
    """What a repair has at hand.

    `so_far` : is told the given and the best model, and trials. `ports` : if they were asked.
    """

    shop: Data
    watch: Watch = field(default_factory=Watch)
    steps: list[str] = field(default_factory=list)
    tests: int = 0
    scale: float = 1.0
    ports: tuple[PortFit, ...] = ()
    so_far: Callable[[Model, Model, Sequence[Model]], None] = lambda given, best, trials: None


def trials_of(bench: Bench, model: Model, *, conventions: bool) -> list[Model]:
    """Every edit of a model, with the ways to read the data otherwise when asked. Best first.

    A glance ranks all edits; those that come first are refitted, with whatever a glance finds about
    as good as the best of them. The rest stay as the glance left them.
    """
    adequate = enough(bench, model)
    glances, values = (
        _glanced(bench, model, near=adequate),
        ((model.refit.values,) if adequate else ()),
    )
    refitted, close = (FURTHER, NEARLY) if adequate else (REFITTED, CLOSE)
    trials: list[Model] = []
    best = np.inf
    for number, glance in enumerate(glances):
        edit = glance.edits[-1]
        idle = (
            adequate
            and glance.free >= model.free
            and glance.cost(bench.scale) > model.cost(bench.scale) - IDLE
        )
        hopeless = number >= refitted and (idle or glance.bic(bench.scale) > best + close)
        if hopeless or isinstance(edit, Convention) or bench.shop.budget.over():
            trials.append(glance)
            continue
        bench.watch(min(number, refitted), refitted, f"{edit.effect}: {edit.change} {edit.where}")
        trial = bench.shop.edited(model, edit, quick=values) or glance
        trials.append(min(trial, glance, key=lambda one: one.refit.cost))
        best = min(best, trials[-1].bic(bench.scale))
        refitted = min(refitted, SETTLED) if enough(bench, trials[-1]) else refitted
    if conventions:
        reached = min(
            (one.refit.cost for one in trials if one.adequate(bench.scale)), default=np.inf
        )
        trials += _read_otherwise(bench, model, reached)
    bench.tests += len(trials)
    return best_first(trials, bench.scale)


def _read_otherwise(bench: Bench, model: Model, reached: float) -> list[Model]:
    """A model on the data as they read with another label; none where they are read otherwise
    already.

    reached : a cost that something else reaches; what cannot come near is left.
    """
    if model.convention != Convention() or bench.shop.budget.over():
        return []
    bench.watch(REFITTED, REFITTED, "other conventions of the data")
    return [
        one for one in bench.shop.read_otherwise(model, reached) if better_everywhere(model, one)
    ]


def _glanced(bench: Bench, model: Model, *, near: bool = False) -> list[Model]:
    """A glance at every edit of a model, best first."""
    edits, glances = bench.shop.insertions(model), []
    for edit in edits:
        if bench.shop.budget.over():
            break
        bench.watch(0, len(edits), f"a glance at {edit.effect}: {edit.change} {edit.where}")
        glances.append(bench.shop.glanced(model, edit, near=near))
    return best_first((one for one in glances if one is not None), bench.scale)


def better_everywhere(before: Model, after: Model) -> bool:
    """True when the whitened residual is smaller at every operating point, as another convention
    must make it.
    """
    pairs = zip(before.refit.residuals, after.refit.residuals, strict=True)
    return all((np.abs(new) ** 2).sum() < (np.abs(old) ** 2).sum() for old, new in pairs)


def dropped_back(bench: Bench, model: Model, trials: list[Model]) -> Model:
    """The model before, refitted from where its best edits ended: a minimum that was missed looks
    like an effect.
    """
    starts = [
        one.refit.values for one in trials[:LOOKED_BACK] if one.convention == model.convention
    ]
    refitted = bench.shop.again(model, starts) if starts else model
    if refitted.refit.cost < model.refit.cost - BETTER:
        bench.steps.append(
            f"dropped back: the model before fits better from there, cost {model.refit.cost:.4g} "
            f"-> {refitted.refit.cost:.4g}"
        )
    return refitted


def first_trials(bench: Bench, given: Model) -> tuple[Model, list[Model]]:
    """Trials of the given model, begun again while dropping back finds a better one."""
    trials = trials_of(bench, given, conventions=not given.adequate(bench.scale))
    for _ in range(2):
        found = dropped_back(bench, given, trials)
        if found.refit.cost >= given.refit.cost - BETTER:
            return found, trials
        given = found
        if given.adequate(
            bench.scale
        ):  # nothing may be missing at all: weigh all edits against the better model
            trials = trials_of(bench, given, conventions=False)
    return given, trials


def explained_in_another_form(bench: Bench, given: Model, trials: list[Model]) -> Model | None:
    """The given model with its delays in another form and one more edit, where both explain all;
    else None.

    It is asked before effects are added to each other: a form other than the device's makes several
    look missing that are not. What is missing bends the choice of a form, so that forms are tried
    beside the first edits, then edits beside the first form.
    """
    firsts = paying(bench, given, trials)
    edited = [one for one in firsts if not is_form(one.edits[-1])][:LABELLED]
    best = _explaining(bench, [trial for one in edited for trial in _with_other_delays(bench, one)])
    if best is None:
        forms = [one for one in firsts if is_form(one.edits[-1])][:1]
        best = _explaining(
            bench, _next(bench, [(one, look) for one in forms for look in _glanced(bench, one)])
        )
    return best


def _explaining(bench: Bench, models: list[Model]) -> Model | None:
    """The best of some stable models that fit as well as the noise allows, which they may tell;
    None where none does.
    """
    ranked = best_first((one for one in models if bench.shop.stable(one)), bench.scale)
    bench.tests += len(models)
    noise = bench.shop.noise
    scale = bench.scale if noise.known or not ranked else min(bench.scale, scale_of(noise, ranked))
    best = next((one for one in ranked if fits(one, noise, scale)), None)
    bench.scale = scale if best else bench.scale
    return best


def repair(
    bench: Bench, given: Model, trials: list[Model], explained: Model | None = None
) -> tuple[Model, list[list[Model]]]:
    """Forward steps from the given model, or from one that explains all already, then a look back.

    Returns the repaired model and, for each of its edits, the trials that compete for its place.
    """
    best = _forward(bench, given, trials) if explained is None else _further(bench, explained)
    return looked_back(bench, given, best, trials)


def looked_back(
    bench: Bench, given: Model, best: Model, trials: list[Model]
) -> tuple[Model, list[list[Model]]]:
    """As `repair`, from a repaired model: what is not needed goes, and what explains clearly more
    takes an edit's place.
    """
    best = _without_idle(bench, given, best)
    rivals = _rivals(bench, given, best, trials)
    better = _overtaking(bench, best, rivals)
    if better is None:
        return best, rivals
    bench.steps.append(
        f"exchanged: {_words(better.edits[-1])} explains clearly more in the place of another edit"
    )
    best = _without_idle(bench, given, better)
    return best, _rivals(bench, given, best, trials)


def _overtaking(bench: Bench, best: Model, rivals: list[list[Model]]) -> Model | None:
    """The best of what could stand in the place of one of several edits, where it is clearly
    better; else None.
    """
    limit = best.bic(bench.scale) - EQUALLY_GOOD.bic
    better = [
        one
        for place in rivals
        for one in place
        if one.bic(bench.scale) < limit and bench.shop.stable(one)
    ]
    return None if len(best.edits) < 2 else next(iter(best_first(better, bench.scale)), None)


def enough(bench: Bench, model: Model) -> bool:
    """True when a model fits as well as the noise allows, as a verdict asks."""
    return fits(model, bench.shop.noise, bench.scale)


def decided(bench: Bench, given: Model, first: Model) -> bool:
    """True where one edit takes nearly all of the squared misfit away, in data whose fits take
    long.
    """
    return bench.shop.ahead < 2 and explains_nearly_all(given, first, bench.scale)


def close(bench: Bench, model: Model) -> bool:
    """True where little more than noise is left, too little to look for another effect in."""
    return bool(model.refit.chi2 <= (1.0 + CLOSE_TO_NOISE**2) * model.refit.dof * bench.scale**2)


def _forward(bench: Bench, given: Model, trials: list[Model]) -> Model:
    firsts = paying(bench, given, trials)
    bench.so_far(given, next(iter(firsts), given), trials)
    if not firsts:
        return given
    if enough(bench, firsts[0]):
        return _further(bench, firsts[0])
    if decided(bench, given, firsts[0]):
        bench.steps.append(
            f"{_words(firsts[0].edits[-1])} explains nearly all; no pairs of edits were tried in "
            "its place"
        )
        further = firsts[0] if close(bench, firsts[0]) else _further(bench, firsts[0])
        return further if enough(bench, further) else firsts[0]
    best = _beam(bench, given, firsts)
    for _ in range(SWAPS if bench.shop.ahead > 1 else 0):
        swapped = (
            None
            if enough(bench, best) or bench.shop.budget.over()
            else _swapped(bench, given, best)
        )
        if swapped is None:
            break
        best = swapped
        bench.so_far(given, best, trials)
    costs = f"cost {given.refit.cost:.4g} -> {best.refit.cost:.4g}" + (
        "" if enough(bench, best) else ", not enough"
    )
    bench.steps.append(f"tried together: {' + '.join(map(_words, best.edits))}; {costs}")
    return _further(bench, best) if enough(bench, best) else best


def _beam(bench: Bench, given: Model, firsts: list[Model]) -> Model:
    """Edits side by side, step by step: a look at every edit of the best few models so far, and
    refits of the best of those.

    A wrong label hides what is missing, and what is missing hides it: the first that pays is
    carried along, and labels are doubted beside the first edits of every step.
    """
    driven = [
        one
        for one in firsts
        if isinstance(one.edits[-1], Insertion) and driven_to_nothing(given, one)
    ]
    labels = [one for one in firsts if isinstance(one.edits[-1], Convention)][:1]
    ahead = bench.shop.ahead
    level = [*dict.fromkeys([*_apart(firsts, ahead), *(driven if ahead > 1 else ()), *labels])]
    level = _relabelled(bench, level, LABELLED)
    best = best_first((firsts[0], level[0]), bench.scale)[0]
    while not enough(bench, best) and not bench.shop.budget.over():
        level = [one for one in level if one.physical < (MOST_EDITS if ahead > 1 else MOST_SLOW)]
        found = _next(bench, [(one, edit) for one in level for edit in _glanced(bench, one)])
        level = _relabelled(bench, _apart(found, min(BEAM, ahead)), 1)
        if not level or level[0].bic(bench.scale) >= best.bic(bench.scale):
            break
        best = level[0]
        bench.so_far(given, best, firsts)
    return best


def _relabelled(bench: Bench, level: list[Model], first: int) -> list[Model]:
    """The models of a step, and its first ones on the data as they read with another label or with
    their delays in another form, where that pays; best first.

    Of labels the usual mistakes alone: any number for a scale takes up a part of whatever is
    missing.
    """
    models = list(level)
    for model in level[:first]:
        if model.physical >= MOST_EDITS or enough(bench, model):
            continue
        trials = _read_otherwise(bench, model, np.inf)
        trials = [
            trial
            for trial in trials
            if isinstance(trial.edits[-1], Convention) and is_usual(trial.edits[-1])
        ]
        trials += _with_other_delays(bench, model)
        bench.tests += len(trials)
        models += best_first(paying(bench, model, trials), bench.scale)[:1]
    return best_first(models, bench.scale)


def _with_other_delays(bench: Bench, model: Model) -> list[Model]:
    """A model with its delays in other forms; none where they were redrawn before, or where a fit
    takes long.
    """
    if bench.shop.ahead < 2 or any(map(is_form, model.edits)):
        return []
    return in_other_forms(bench.shop, model, bench.scale)


def _swapped(bench: Bench, given: Model, best: Model) -> Model | None:
    """The best exchange of one edit for another, refitted; None where none is better."""
    looks = []
    for place, edit in enumerate(best.edits):
        alone = None if isinstance(edit, Convention) else without(bench.shop, given, best, place)
        if alone is not None and not bench.shop.budget.over():
            looks += [(alone, one) for one in _glanced(bench, alone)]
    missed = [
        (alone, look)
        for alone, look in looks
        if look.free > alone.free and look.cost() > alone.cost()
    ]
    for pairs, many in ((looks, CARRIED), (missed, MISSED)):
        found = next(iter(_next(bench, pairs, many)), best)
        if found.bic(bench.scale) < best.bic(bench.scale) - EQUALLY_GOOD.bic:
            return found
    return None


def _next(bench: Bench, looks: list[tuple[Model, Model]], many: int = CARRIED) -> list[Model]:
    """Of looks, each with the model that it edits, so many refitted, without twins; those that pay,
    best first.
    """
    bench.tests += len(looks)
    models: list[Model] = []
    chosen: list[Model] = []
    turns = dict.fromkeys((_first(before) for before, _ in looks), 0)
    most = many // min(2, max(1, len(turns)))  # that begin alike
    for before, look in sorted(looks, key=lambda pair: pair[1].bic(bench.scale)):
        if len(chosen) >= many or bench.shop.budget.over():
            break
        twin = any(abs(look.cost() - other.cost()) <= APART * other.cost() for other in chosen)
        if twin or turns[_first(before)] >= most:
            continue
        chosen.append(look)
        turns[_first(before)] += 1
        edit = look.edits[-1]
        if isinstance(edit, Convention):
            continue
        bench.watch(len(chosen), many, f"together with {_words(edit)}")
        model = min(
            bench.shop.edited(before, edit) or look, look, key=lambda trial: trial.refit.cost
        )
        if _pays(bench, before, model, bench.tests):
            models.append(model)
    noise = bench.shop.noise
    if not noise.known and models:
        bench.scale = min(
            bench.scale, scale_of(noise, sorted(models, key=lambda one: one.refit.cost))
        )
    return best_first(models, bench.scale)


def _apart(models: list[Model], many: int) -> list[Model]:
    """So many models that leave residuals far apart and begin otherwise, as they come, then the
    others without twins: a delay, a hold and a late current do much the same, and what goes with
    the best first edit would fill a beam by itself.
    """
    chosen: list[Model] = []
    for part, most in ((SPREAD, BEAM // 2), (APART, many)):
        for model in models:
            alike = (
                0
                if len(model.edits) < 2
                else sum(_first(other) == _first(model) for other in chosen)
            )
            room = len(chosen) < many and alike < most
            if room and all(_between(model, other) > part * other.refit.cost for other in chosen):
                chosen.append(model)
    return chosen


def _between(first: Model, other: Model) -> float:
    """chi2 of the difference of what two models leave, each on the data as it reads them."""
    return sum(
        (np.abs(a - b) ** 2).sum()
        for a, b in zip(first.refit.residuals, other.refit.residuals, strict=True)
    )


def _first(model: Model) -> str:
    """What a chain of edits begins with."""
    return getattr(model.edits[0], "effect", LABEL) if model.edits else ""


def paying(bench: Bench, before: Model, trials: list[Model]) -> list[Model]:
    """Of trials those that pay and leave a stable model, best first."""
    return [one for one in trials if _pays(bench, before, one, len(trials))]


def _pays(bench: Bench, before: Model, after: Model, tests: int) -> bool:
    """Whether an edit, of so many that were tried, pays and leaves a stable model."""
    pays = significant(before, after, tests, bench.scale) and bench.shop.pays(before, after)
    return pays and bench.shop.stable(after)


def _further(bench: Bench, model: Model) -> Model:
    while model.physical < MOST_EDITS and not bench.shop.budget.over():
        trials = trials_of(bench, model, conventions=False)
        model = dropped_back(bench, model, trials)
        candidate = next(iter(paying(bench, model, trials)), None)
        if candidate is None or (
            enough(bench, model)
            and candidate.bic(bench.scale) > model.bic(bench.scale) - EQUALLY_GOOD.bic
        ):
            return model
        model = candidate
    return model


def _without_idle(bench: Bench, given: Model, best: Model) -> Model:
    """Leave out each edit in turn: what the others do as well without it goes, what would not be
    tried beside them, and forms of delays that are there no more.
    """
    best, place = without_lost_forms(bench.shop, given, best), 0
    while len(best.edits) > 1 and place < len(best.edits) and not bench.shop.budget.over():
        alone = without(bench.shop, given, best, place)
        if (
            alone is not None
            and bench.shop.stable(alone)
            and not _needed(bench, best.edits[place], alone, best)
        ):
            bench.steps.append(
                f"looked back: {_words(best.edits[place])} is not needed beside the rest"
            )
            best, place = alone, 0
        else:
            place += 1
    return best


def _needed(bench: Bench, edit: Insertion | Convention, alone: Model, best: Model) -> bool:
    """Whether an edit pays in the best model beside the others alone, and would be tried there."""
    return significant(alone, best, bench.tests, bench.scale) and bench.shop.would_try(alone, edit)


def _rivals(bench: Bench, given: Model, best: Model, trials: list[Model]) -> list[list[Model]]:
    """For each edit what else could stand in its place beside the others: of effects by a look, the
    first ones by a quick refit from its values and those of the answer; of a label another label.
    """
    if len(best.edits) < 2:
        return [trials] * len(best.edits)
    if bench.shop.budget.over() or (
        bench.shop.ahead < 2 and not enough(bench, best)
    ):  # nothing is named of it
        return [[] for _ in best.edits]
    rivals: list[list[Model]] = []
    for place, edit in enumerate(best.edits):
        alone = without(bench.shop, given, best, place)
        if alone is None:
            rivals.append([])
        elif isinstance(edit, Convention):
            rivals.append(_read_otherwise(bench, alone, best.refit.cost))
        else:
            looks, values = _glanced(bench, alone), (best.refit.values, alone.refit.values)
            edits = [look.edits[-1] for look in looks[:CARRIED]]
            refitted = [
                bench.shop.edited(alone, one, quick=values)
                for one in edits
                if isinstance(one, Insertion)
            ]
            rivals.append([model for model in (*refitted, *looks[CARRIED:]) if model is not None])
    return rivals


def _words(edit: Insertion | Convention) -> str:
    return (
        edit.words
        if isinstance(edit, Convention)
        else f"{edit.effect} ({edit.change} {edit.where})"
    )
