"""The repair of a model, edit by edit: try everything, keep what pays most, look back, go on until nothing pays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ibrid.gap.convention import Convention
from ibrid.gap.data import Data
from ibrid.gap.trial import ALIKE, TRIAL_DRAWS, Model, significant
from ibrid.gap.watching import Watch
from ibrid.parts.practice import Insertion

#: Edits at most.
MOST_EDITS = 3
#: First edits, apart in cost, from which every second one is tried in a hurry when no single one is enough; and those from
#: which that is then done with care.
AHEAD, BEAM = 12, 3
#: Edits that are refitted, in the order of a glance, and the distance in the information criterion up to which more are.
REFITTED, CLOSE = 12, 30.0
#: The same where the model fits already, and only what pays well beside it counts.
FURTHER = 4
#: Part of the cost by which two trials must differ, or they say the same of the data.
APART = 1e-4
#: Of the best trials: those from which the model before is refitted (drop-back).
LOOKED_BACK = 3
#: Gain in cost that makes a model before worth starting over.
BETTER = 1.0


@dataclass
class Bench:
    """What a repair has at hand. `so_far` : is told the given and the best model, and the trials, when there are new ones."""

    shop: Data
    watch: Watch = field(default_factory=Watch)
    steps: list[str] = field(default_factory=list)
    tests: int = 0
    scale: float = 1.0
    so_far: Callable[[Model, Model, Sequence[Model]], None] = lambda given, best, trials: None


def trials_of(bench: Bench, model: Model, *, conventions: bool) -> list[Model]:
    """Every edit of a model, with the ways to read the data otherwise when asked. Best first.

    A glance ranks all edits; those that come first are refitted, with whatever a glance finds about as good as the best of them.
    The rest stay as the glance left them.
    """
    adequate = model.adequate(bench.scale)
    glances = _glanced(bench, model, nominal=not adequate)
    refitted, found, best = (FURTHER if adequate else REFITTED), [], np.inf
    for number, glance in enumerate(glances):
        edit = glance.edits[-1]
        hopeless = number >= refitted and glance.bic(bench.scale) > best + CLOSE
        if hopeless or isinstance(edit, Convention) or bench.watch.late():
            found.append(glance)
            continue
        bench.watch(min(number, refitted), refitted, f"{edit.effect}: {edit.change} {edit.where}")
        trial = bench.shop.edited(model, edit) or glance
        found.append(min(trial, glance, key=lambda one: one.refit.cost))
        best = min(best, found[-1].bic(bench.scale))
    if conventions and model.convention == Convention() and not bench.watch.late():
        bench.watch(refitted, refitted, "other conventions of the data")
        enough = min((one.refit.cost for one in found if one.adequate(bench.scale)), default=np.inf)
        found += [one for one in bench.shop.read_otherwise(model, enough) if better_everywhere(model, one)]
    bench.tests += len(found)
    return sorted(found, key=lambda one: one.bic(bench.scale))


def _glanced(bench: Bench, model: Model, *, nominal: bool = True) -> list[Model]:
    """A glance at every edit of a model, best first."""
    edits, glances = bench.shop.insertions(model), []
    for edit in edits:
        if bench.watch.late():
            break
        bench.watch(0, len(edits), f"a glance at {edit.effect}: {edit.change} {edit.where}")
        glances.append(bench.shop.glanced(model, edit, nominal=nominal))
    return sorted((one for one in glances if one is not None), key=lambda one: one.bic(bench.scale))


def better_everywhere(before: Model, after: Model) -> bool:
    """True when the whitened residual is smaller at every operating point, as another convention must make it."""

    def squares(model: Model) -> list[float]:
        return [float((np.abs(one) ** 2).sum()) for one in model.refit.residuals]

    return all(new < old for old, new in zip(squares(before), squares(after), strict=True))


def dropped_back(bench: Bench, model: Model, trials: list[Model]) -> Model:
    """The model before, refitted from where its best edits ended: a minimum that was missed looks like an effect."""
    starts = [one.refit.values for one in trials[:LOOKED_BACK] if one.convention == model.convention]
    found = bench.shop.again(model, starts) if starts else model
    if found.refit.cost < model.refit.cost - BETTER:
        bench.steps.append(
            f"dropped back: the model before fits better from there, cost {model.refit.cost:.4g} -> {found.refit.cost:.4g}"
        )
    return found


def first_trials(bench: Bench, given: Model) -> tuple[Model, list[Model]]:
    """Trials of the given model, begun again while dropping back finds a better one."""
    trials = trials_of(bench, given, conventions=not given.adequate(bench.scale))
    for _ in range(2):
        found = dropped_back(bench, given, trials)
        if found.refit.cost >= given.refit.cost - BETTER:
            return found, trials
        given = found
        if given.adequate(bench.scale):  # nothing may be missing at all: weigh all edits against the better model
            trials = trials_of(bench, given, conventions=False)
    return given, trials


def repair(bench: Bench, given: Model, trials: list[Model]) -> tuple[Model, list[list[Model]]]:
    """Forward steps from the given model, then a look back at every edit that was made.

    Returns the repaired model and, for each of its edits, the trials that compete for its place.
    """
    best = _looked_back(bench, given, _forward(bench, given, trials))
    return best, _rivals(bench, given, best, trials)


def _forward(bench: Bench, given: Model, trials: list[Model]) -> Model:
    firsts = paying(bench, given, trials)
    bench.so_far(given, next(iter(firsts), given), trials)
    if not firsts:
        return given
    if firsts[0].adequate(bench.scale):
        return _further(bench, firsts[0])
    best = given
    for start in _promising(bench, firsts):
        found = _further(bench, start)
        bench.steps.append(_tried_together(bench, given, found))
        if best is given or found.bic(bench.scale) < best.bic(bench.scale):
            best = found
            bench.so_far(given, best, trials)
        if best.adequate(bench.scale):
            break
    return best


def paying(bench: Bench, before: Model, trials: list[Model]) -> list[Model]:
    """Of trials those that pay and leave a stable model, best first."""
    return [one for one in trials if significant(before, one, len(trials), bench.scale) and bench.shop.stable(one)]


def _further(bench: Bench, model: Model) -> Model:
    while len(model.edits) < MOST_EDITS and not bench.watch.late():
        trials = trials_of(bench, model, conventions=False)
        model = dropped_back(bench, model, trials)
        found = next(iter(paying(bench, model, trials)), None)
        if found is None:
            return model
        if model.adequate(bench.scale) and found.bic(bench.scale) > model.bic(bench.scale) - ALIKE:
            return model
        model = found
    return model


def _looked_back(bench: Bench, given: Model, best: Model) -> Model:
    """Leave out each edit in turn: what the others do as well without it goes."""
    place = 0
    while len(best.edits) > 1 and place < len(best.edits) and not bench.watch.late():
        alone = _without(bench, given, best, place)
        if alone is not None and not significant(alone, best, bench.tests, bench.scale) and bench.shop.stable(alone):
            bench.steps.append(f"looked back: {_words(best.edits[place])} is not needed beside the rest")
            best, place = alone, 0
        else:
            place += 1
    return best


def _rivals(bench: Bench, given: Model, best: Model, trials: list[Model]) -> list[list[Model]]:
    """For each edit what else could stand in its place beside the others, by a quick refit from the answer.

    Nothing is tried in the place of a convention.
    """
    if len(best.edits) < 2:
        return [trials] * len(best.edits)
    if bench.watch.late():
        return [[] for _ in best.edits]
    rivals: list[list[Model]] = []
    for place, edit in enumerate(best.edits):
        alone = None if isinstance(edit, Convention) else _without(bench, given, best, place)
        rivals.append([] if alone is None else _quickly_edited(bench, alone, best))
    return rivals


def _quickly_edited(bench: Bench, model: Model, best: Model) -> list[Model]:
    """Every edit of a model, refitted from its own values and those of the answer alone."""
    values = (best.refit.values, model.refit.values)
    found = [bench.shop.edited(model, edit, quick=values) for edit in bench.shop.insertions(model)]
    return [one for one in found if one is not None]


def _without(bench: Bench, given: Model, best: Model, place: int) -> Model | None:
    """The repaired model without one of its edits, refitted; None where the others do not apply without it."""
    return _replayed(bench, given, (*best.edits[:place], *best.edits[place + 1 :]), best)


def _replayed(bench: Bench, given: Model, edits: tuple[Insertion | Convention, ...], best: Model) -> Model | None:
    """The given model with some edits, refitted from where the best one ended; None where they do not apply to it."""
    model, done = given, ()
    for edit in edits:
        if isinstance(edit, Convention):
            model = replace(model, convention=edit, extra=best.extra)
        else:
            twin = next((one for one in bench.shop.insertions(model) if _same(one, edit)), None)
            if twin is None:
                return None
            model, edit = replace(model, diagram=twin.diagram), twin
        done = (*done, edit)
    return bench.shop.refitted(replace(model, edits=done), [best.refit.values, {}], draws=TRIAL_DRAWS)


def _tried_together(bench: Bench, given: Model, found: Model) -> str:
    edits = " + ".join(map(_words, found.edits))
    enough = "" if found.adequate(bench.scale) else ", not enough"
    return f"tried together: {edits}; cost {given.refit.cost:.4g} -> {found.refit.cost:.4g}{enough}"


def _same(one: Insertion | Convention, other: Insertion | Convention) -> bool:
    if isinstance(one, Convention) or isinstance(other, Convention):
        return one == other
    return (one.effect, one.change, one.where) == (other.effect, other.change, other.where)


def _promising(bench: Bench, firsts: list[Model]) -> list[Model]:
    """Of first edits those from which a second one leads furthest: a first look at every pair, a quick refit of the best."""
    chosen: list[Model] = []
    for one in firsts:
        if all(abs(one.cost() - other.cost()) > APART * other.cost() for other in chosen):
            chosen.append(one)
    ahead: list[tuple[float, Model]] = []
    for number, first in enumerate(chosen[:AHEAD]):
        if bench.watch.late():
            break
        bench.watch(number, 2 * min(len(chosen), AHEAD), f"pairs with {_words(first.edits[-1])}")
        seconds = _glanced(bench, first)
        bench.tests += len(seconds)
        ahead.append((min((one.bic(bench.scale) for one in seconds), default=np.inf), first))
    return [first for _, first in sorted(ahead, key=lambda pair: pair[0])[:BEAM]] or chosen[:1]


def _words(edit: Insertion | Convention) -> str:
    return edit.words if isinstance(edit, Convention) else f"{edit.effect} ({edit.change} {edit.where})"
