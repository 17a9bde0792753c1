"""The repair of a model, edit by edit: try everything, keep what pays most, look back, go on until nothing pays."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ibrid.gap.convention import Convention
from ibrid.gap.effect import Insertion
from ibrid.gap.trial import ALIKE, TRIAL_DRAWS, Model, Workshop, significant

#: Edits at most.
MOST_EDITS = 3
#: First edits from which a second one is tried when no single one is enough.
BEAM = 3
#: Of the best trials: those from which the model before is refitted (drop-back).
LOOKED_BACK = 3
#: Gain in cost that makes a model before worth starting over.
BETTER = 1.0


@dataclass
class Bench:
    """What a repair has at hand. `tell` : is told what is going on, (done, of, words)."""

    shop: Workshop
    tell: Callable[[int, int, str], None] = lambda done, of, words: None
    steps: list[str] = field(default_factory=list)
    tests: int = 0
    scale: float = 1.0


def trials_of(bench: Bench, model: Model, *, conventions: bool) -> list[Model]:
    """Every edit of a model, refitted; with the ways to read the data otherwise when asked. Best first."""
    edits = bench.shop.insertions(model)
    found: list[Model] = []
    for number, edit in enumerate(edits):
        bench.tell(number, len(edits), f"{edit.effect}: {edit.change} {edit.where}")
        if (one := bench.shop.edited(model, edit)) is not None:
            found.append(one)
    if conventions and model.convention == Convention():
        bench.tell(len(edits), len(edits), "other conventions of the data")
        found += [one for one in bench.shop.read_otherwise(model) if better_everywhere(model, one)]
    bench.tests += len(found)
    return sorted(found, key=lambda one: one.bic(bench.scale))


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

    Returns the repaired model and, for each of its edits, the trials that competed for its place.
    """
    best, rivals = given, []
    candidates = [(one, [trials]) for one in paying(bench, given, trials)]
    if not candidates:
        return given, []
    if candidates[0][0].adequate(bench.scale):
        best, rivals = candidates[0]
        best, rivals = _further(bench, best, rivals)
        return _looked_back(bench, given, best, rivals)
    for start, history in _distinct(candidates)[:BEAM]:
        found, more = _further(bench, start, history)
        bench.steps.append(_tried_together(bench, given, found))
        if best is given or found.bic(bench.scale) < best.bic(bench.scale):
            best, rivals = found, more
        if best.adequate(bench.scale):
            break
    return _looked_back(bench, given, best, rivals)


def paying(bench: Bench, before: Model, trials: list[Model]) -> list[Model]:
    """Of trials those that pay and leave a stable model, best first."""
    return [one for one in trials if significant(before, one, len(trials), bench.scale) and bench.shop.stable(one)]


def _further(bench: Bench, model: Model, history: list[list[Model]]) -> tuple[Model, list[list[Model]]]:
    while len(model.edits) < MOST_EDITS:
        trials = trials_of(bench, model, conventions=False)
        model = dropped_back(bench, model, trials)
        found = next(iter(paying(bench, model, trials)), None)
        if found is None:
            return model, history
        if model.adequate(bench.scale) and found.bic(bench.scale) > model.bic(bench.scale) - ALIKE:
            return model, history
        model, history = found, [*history, trials]
    return model, history


def _looked_back(bench: Bench, given: Model, best: Model, rivals: list[list[Model]]) -> tuple[Model, list[list[Model]]]:
    """Leave out each edit in turn: what the others do as well without it goes."""
    place = 0
    while len(best.edits) > 1 and place < len(best.edits):
        others = (*best.edits[:place], *best.edits[place + 1 :])
        alone = _replayed(bench, given, others, best)
        if alone is not None and not significant(alone, best, bench.tests, bench.scale) and bench.shop.stable(alone):
            bench.steps.append(f"looked back: {_words(best.edits[place])} is not needed beside the rest")
            best, rivals, place = alone, [one for index, one in enumerate(rivals) if index != place], 0
        else:
            place += 1
    return best, rivals


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
    refit = bench.shop.refitter(model.convention).refit(model.diagram, [best.refit.values, {}], draws=TRIAL_DRAWS)
    return None if refit is None else replace(model, refit=refit, edits=done)


def _tried_together(bench: Bench, given: Model, found: Model) -> str:
    edits = " + ".join(map(_words, found.edits))
    enough = "" if found.adequate(bench.scale) else ", not enough"
    return f"tried together: {edits}; cost {given.refit.cost:.4g} -> {found.refit.cost:.4g}{enough}"


def _same(one: Insertion | Convention, other: Insertion | Convention) -> bool:
    if isinstance(one, Convention) or isinstance(other, Convention):
        return one == other
    return (one.effect, one.change, one.where) == (other.effect, other.change, other.where)


def _distinct(candidates: list[tuple[Model, list[list[Model]]]]) -> list[tuple[Model, list[list[Model]]]]:
    """The best candidate of each effect."""
    seen: set[str] = set()
    found = []
    for one in candidates:
        edit = one[0].edits[-1]
        name = "convention" if isinstance(edit, Convention) else edit.effect
        if name not in seen:
            seen.add(name)
            found.append(one)
    return found


def _words(edit: Insertion | Convention) -> str:
    return edit.words if isinstance(edit, Convention) else f"{edit.effect} ({edit.change} {edit.where})"
