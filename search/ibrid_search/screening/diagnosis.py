"""What a fitted program lacks, ranked: a few warm steps of every edit that control practice knows,
instead of a fit of each.

A look descends from where the parent's fit ended, from the usual strengths of what is new, and from
some fresh draws: first on the logarithm of the response, which leads to the right valley, then on
the error itself. It costs a hundredth of a fit and is an upper end of what the fit will find, so
the truth is hardly ever missed among the first dozen. Verdicts rest on fits.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from math import inf, log, sqrt
from types import MappingProxyType

import numpy as np

from ibrid.errors import DiagramError
from ibrid.fit import kernel
from ibrid.fit.least_squares import LEVENBERG, Batch
from ibrid.fit.objective import objective_for
from ibrid.fit.problem import Misfit, Problem
from ibrid.fit.starts import TEXTBOOK_DECADES, StartDrawer
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.parts.catalogue import CATALOGUE, FAMILIES, insertions
from ibrid.parts.editing.device import device_parts
from ibrid.parts.editing.edit import NotInVocabulary
from ibrid.parts.editing.practice import Effect
from ibrid.parts.editing.view import views_of
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import (
    published_names,
    published_values,
    shipped_names,
    textbook,
)
from ibrid.study import Study
from ibrid.telling import Tell
from ibrid_search.screening.merit import Criterion, least_error
from ibrid_search.screening.oddities import SOUND, Oddities, absurd
from ibrid_search.screening.slices import Slice
from ibrid_search.screening.trying import NO_ANSWER, PRICE, problems_of

#: Per operating point, name -> value.
Values = Sequence[Mapping[str, float]]
#: From a problem and what draws its starts to the ends of some descents.
Descend = Callable[[Problem, StartDrawer, np.random.Generator], Batch]

#: Draws of the numbers that the parent lacks, and of all numbers; starts that descend on the
#: logarithm, and steps; ends that go on, as many straight from the parent's values, and steps.
DRAWS, FRESH, KEPT, FAR, CARRIED, NEAR = 8, 64, 6, 16, 3, 16
#: Draws of a whole diagram of which nothing is known, those that descend, and steps on the
#: logarithm and on the error.
SCREENED, DESCENDING, STEPS = 96, 8, 24
#: Operating points and frequencies of each that a look takes at most, evenly chosen; a fit takes
#: all.
MOST_POINTS, MOST_FREQUENCIES = 3, 32
#: Looks that are kept, since a candidate is asked about more than once.
REMEMBERED = 20_000
#: What an unusual edit costs beside a usual one, in free numbers.
UNUSUAL = 2


@dataclass(frozen=True, eq=False)
class Edited:
    """An edit of a diagram.

    `words` : what changes, in a line. `part` : the idea behind it. `strengths` : new free parameter
    -> values to begin from. `usual` : False for a block or a wire anywhere.
    """

    diagram: Diagram
    words: str
    part: str
    strengths: Mapping[str, tuple[float, ...]]
    usual: bool = True


@dataclass(frozen=True, eq=False)
class RankedEdit:
    """How far a few steps lead.

    `error` : as the run measures it, infinite without a response. `free` : numbers of an operating
    point. `values` : where they lead. `worth` : by what looks are ranked, the lower the better.
    """

    edit: Edited
    error: float
    free: int
    worth: float
    values: Values = ()


def published_structures(study: Study) -> frozenset[str]:
    """Hashes of the shipped diagrams that the vocabulary can draw."""
    examined = (study.examined(textbook(name), name) for name in shipped_names())
    return frozenset(found.hash for found in examined if found.hash)


def effects_of(diagram: Diagram, study: Study) -> list[Edited]:
    """Every edit by an effect of the catalogue, but for forms of what is there."""
    return _edited(diagram, study, (effect for effect in CATALOGUE if not effect.form))


def forms_of(diagram: Diagram, study: Study) -> list[Edited]:
    """The diagram with its delays as the device may draw them otherwise: a detail, which records of
    events alone do not show.
    """
    return _edited(
        diagram, study, (effect for effect in CATALOGUE if effect.form and study.events is None)
    )


def _edited(diagram: Diagram, study: Study, effects: Iterable[Effect]) -> list[Edited]:
    found = insertions(diagram, study.kinds, tuple(effects))
    return [
        Edited(one.diagram, f"{one.effect}: {one.change} {one.where}", one.effect, one.parameters)
        for one in found
    ]


def ideas_of(diagram: Diagram, study: Study) -> list[Edited]:
    """Every edit by another idea that a search tries, each new structure once."""
    return [one for one in _searched(diagram, study) if one.usual]


def frame_of(diagram: Diagram, study: Study) -> list[Edited]:
    """Of both those that put in a layer of control which every inverter has, or another output
    filter; none where all layers are there. What refines a control is looked at once it stands.
    """
    if not (missing := _missing_layers(diagram, study)):
        return []
    plants = _plants(diagram, study)
    both = (*effects_of(diagram, study), *ideas_of(diagram, study))
    return [
        one
        for one in both
        if _missing_layers(one.diagram, study) < missing or _plants(one.diagram, study) != plants
    ]


def _missing_layers(diagram: Diagram, study: Study) -> int:
    return sum(view.roles.missing_layers for view in views_of(diagram, study.kinds))


def _plants(diagram: Diagram, study: Study) -> list[str]:
    return sorted(view.kind(view.roles.plant) for view in views_of(diagram, study.kinds))


def anywhere_of(diagram: Diagram, study: Study) -> list[Edited]:
    """Every block or wire anywhere that makes a structure of its own."""
    return [one for one in _searched(diagram, study) if not one.usual]


def _searched(diagram: Diagram, study: Study) -> Iterator[Edited]:
    """What no effect of the catalogue makes, what is usual first."""
    seen = {
        study.hash_of(one)
        for one in (diagram, *(effect.diagram for effect in effects_of(diagram, study)))
    }
    views = views_of(diagram, study.kinds)
    for family, view in product(sorted(FAMILIES, key=lambda family: not family.usual), views):
        for move in family.moves(view):
            try:
                drawn = view.drawn(move.draw)
                key = study.hash_of(drawn.diagram)
            except (NotInVocabulary, DiagramError):
                continue
            if key not in seen:
                seen.add(key)
                banks = {name: strength.bank for name, strength in drawn.strengths.items()}
                yield Edited(drawn.diagram, view.words(move), family.name, banks, family.usual)


def itself_of(diagram: Diagram, study: Study) -> list[Edited]:
    """The diagram as it is: what is left of another."""
    return [Edited(diagram, "", "", {})]


class Looker:
    """Looks at diagrams against the sweep of a study; the same look twice is the same."""

    screened, descending = SCREENED, DESCENDING

    def __init__(self, study: Study, criterion: Criterion) -> None:
        kernel.load()
        self.study, self.criterion = study, criterion
        self._known: dict[str, RankedEdit] = {}
        self._slice: Slice[RankedEdit] | None = None
        self.groups = [coarse(group, MOST_POINTS, MOST_FREQUENCIES) for group in study.groups]

    @contextmanager
    def within(self, seconds: float | None) -> Iterator[Slice[RankedEdit]]:
        """A slice of looks, which a SliceOver ends; of all of them where `seconds` is None."""
        self._slice = part = Slice[RankedEdit](seconds)
        try:
            yield part
        finally:
            self._slice = None

    def stage(self, edits: Sequence[object]) -> None:
        """Tell a slice that looks at so many edits begin."""
        if self._slice is not None:
            self._slice.stage(edits)

    def shipped(self, devices: int, tell: Tell) -> Iterator[tuple[Edited, Mapping[str, float]]]:
        """The shipped diagrams of so many devices that the vocabulary can draw, with what is
        typical of their values.
        """
        for place, name in enumerate(names := shipped_names()):
            tell(f"first look at {name}, {place + 1} of {len(names)}", place / len(names))
            diagram = textbook(name)
            if self.study.examined(diagram, name).violations:
                continue  # of kinds that the vocabulary lacks, for instance
            if len(device_parts(diagram, self.study.kinds)) == devices:
                known = published_values(name) if name in published_names() else {}
                yield Edited(diagram, f"the shipped diagram {name}", name, {}), known

    def ranked(
        self, edits: Iterable[Edited], values: Values, *, settled: bool = False
    ) -> list[RankedEdit]:
        """Looks at edits of a diagram with fitted values, the best first.

        settled : it leaves nothing but noise.
        """
        edits = [*edits]
        self.stage(edits)
        return sorted((self.look(one, values) for one in edits), key=lambda look: look.worth)

    def worth(self, error: float, free: float, odd: Oddities = SOUND) -> float:
        """What structures are compared by: ln(error) and the price of the free numbers, as in the
        choice of the answer.
        """
        return log(max(error, least_error(odd))) + self.price * (free + 2 * odd.total)

    @property
    def price(self) -> float:
        """Of a free number, in ln(error)."""
        return self.criterion.price / self.criterion.alone if self.criterion.floor.known else PRICE

    def textbooks(
        self, devices: int = 1, tell: Tell = lambda words, share: None
    ) -> tuple[RankedEdit, ...]:
        """The shipped diagrams of so many devices that have a response, by descents from draws of
        their numbers, the best first.

        tell : of every look, and the share.
        """
        shipped = [*self.shipped(devices, tell)]
        self.stage(shipped)
        looks = [self.fresh(*one) for one in shipped]
        return tuple(
            sorted((one for one in looks if np.isfinite(one.error)), key=lambda look: look.worth)
        )

    def fresh(
        self, edit: Edited, typical: Mapping[str, float] = MappingProxyType({})
    ) -> RankedEdit:
        """A diagram of which nothing is known but what is `typical` of some values, by descents
        from draws, on the logarithm of the response first.
        """

        def descend(problem: Problem, drawer: StartDrawer, rng: np.random.Generator) -> Batch:
            far, near = self._misfits(problem)
            x = drawer.draw(rng, self.screened, TEXTBOOK_DECADES[0])
            if typical:
                x = np.concatenate(
                    [x, drawer.completed(rng, [typical] * len(problem.points), DRAWS)]
                )
            batch = LEVENBERG.go(far, LEVENBERG.begin(far, x).best(self.descending), FAR).best(KEPT)
            ends = LEVENBERG.go(far, batch, FAR).best(KEPT)
            return LEVENBERG.go(near, LEVENBERG.begin(near, ends.x), STEPS)

        key = f"fresh {self.study.hash_of(edit.diagram)} {sorted(typical.items())}"
        return self._kept(key, edit, lambda: self._looked(edit, [descend] * len(self.groups)))

    def look(self, edit: Edited, values: Values, *, glance: bool = False) -> RankedEdit:
        """An edit from its parent's values, one mapping for each fitted operating point.

        glance : only from there, a third of the work, and enough where the values have not bent to
        fit. The last ones are kept.
        """
        key = (
            f"{glance} {self.study.hash_of(edit.diagram)} "
            f"{[sorted(point.items()) for point in values]}"
        )
        return self._kept(key, edit, lambda: self._look(edit, values, glance))

    def _kept(self, key: str, edit: Edited, make: Callable[[], RankedEdit]) -> RankedEdit:
        """A look that is known by its key, or made now."""
        if key not in self._known:
            if self._slice is not None:
                self._slice.before_look()
            if len(self._known) >= REMEMBERED:
                self._known.clear()
            self._known[key] = make()
        look = replace(self._known[key], edit=edit)
        if self._slice is not None:
            self._slice.met(look)
        return look

    def _look(self, edit: Edited, values: Values, glance: bool) -> RankedEdit:
        length = max((len(bank) for bank in edit.strengths.values()), default=0)
        banks = [
            {name: bank[min(j, len(bank) - 1)] for name, bank in edit.strengths.items()}
            for j in range(length)
        ]

        def descend(known: Values) -> Descend:
            def run(problem: Problem, drawer: StartDrawer, rng: np.random.Generator) -> Batch:
                far, near = self._misfits(problem)
                starts = [
                    drawer.completed(rng, [{**one, **bank} for one in known], 1) for bank in banks
                ]
                x = np.concatenate([*starts, drawer.completed(rng, known, DRAWS)])
                own = LEVENBERG.go(near, LEVENBERG.begin(near, x).best(CARRIED), NEAR)
                if glance:
                    return own
                fresh = drawer.draw(rng, FRESH, TEXTBOOK_DECADES[0])
                order = np.argsort(problem.costs(fresh, "log").sum(axis=1), kind="stable")[:KEPT]
                led = LEVENBERG.go(
                    far, LEVENBERG.begin(far, np.concatenate([own.x, fresh[order]])), FAR
                ).best(CARRIED)
                led = LEVENBERG.go(near, LEVENBERG.begin(near, led.x), NEAR)
                return own if own.cost.min() <= led.cost.min() else led

            return run

        at = dict(zip(self.study.fitted.names, values, strict=True))
        return self._looked(
            edit, [descend([at[point.op.name] for point in group]) for group in self.groups]
        )

    def _looked(self, edit: Edited, ways: Sequence[Descend]) -> RankedEdit:
        """An edit without matrices looks worthless, and so does one whose kind, a user's own,
        breaks off: its evaluation says why.
        """
        study = self.study
        errors: list[float] = []
        by_point: dict[str, Mapping[str, float]] = {}
        free = bound = 0
        try:
            compiled = study.compiled(edit.diagram)
            rng = np.random.default_rng([study.seed, int(compiled.structure_hash[:8], 16)])
            problems = problems_of(compiled, study, self.groups)
            for group, problem, descend in zip(self.groups, problems, ways, strict=True):
                batch = descend(
                    problem, StartDrawer(problem, compiled.wiring, study.sweep.omega_0), rng
                )
                best = int(np.argmin(batch.cost))
                bound = max(bound, int(problem.at_bound(batch.x[best]).sum()))
                scale = self.criterion.floor.level if objective_for(group) == "sigma" else 1.0
                errors.append(sqrt(batch.cost[best] / len(group)) * scale)  # as the run measures it
                by_point |= {
                    p.op.name: problem.values_at(batch.x[best], k) for k, p in enumerate(group)
                }
                free = problem.size
        except NO_ANSWER:
            return RankedEdit(edit, inf, 0, inf)
        error = float(np.mean(errors))
        if not np.isfinite(error):
            return RankedEdit(edit, inf, free, inf)
        first = next(iter(by_point.values()))
        values = tuple(by_point.get(name, first) for name in study.fitted.names)
        odd = Oddities(
            at_bound=bound, absurd=max(absurd(edit.diagram, one, study.kinds) for one in values)
        )
        return RankedEdit(
            edit, error, free, self.worth(error, free + (0 if edit.usual else UNUSUAL), odd), values
        )

    def _misfits(self, problem: Problem) -> tuple[Misfit, Misfit]:
        return Misfit(problem, "log"), Misfit(problem, objective_for(problem.points))
