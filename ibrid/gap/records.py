"""Records of events, alone or beside a sweep, as a kind of `Data`: an edit is of the program, or a limit beside it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ibrid.errors import IbridError
from ibrid.gap.convention import Convention
from ibrid.gap.data import Values
from ibrid.gap.event_fit import EventFit, EventFitter, without
from ibrid.gap.event_noise import EventNoise
from ibrid.gap.event_places import LimitPlace, limit_places
from ibrid.gap.held_out import HeldOut
from ibrid.gap.port_map import PortFit
from ibrid.gap.prior import Prior
from ibrid.gap.refit import Refitter
from ibrid.gap.trial import Model, strengths
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.catalogue import insertions
from ibrid.parts.practice import Effect, Insertion
from ibrid.playback.limits import Limit
from ibrid.structure.diagram import Diagram

#: Steps of a glance, of a fit, and of the given model; starts that are descended.
GLANCE, WHOLE, GIVEN, KEPT = 1, 12, 12, 2
#: Draws beside the nominal values, of the given model.
DRAWS = 7
#: Records from which on each is left out in turn.
FEWEST = 3


class Records:
    """Records and perhaps a small-signal sweep, weighed by a noise.

    refitter : of the sweep, None without one. limits : beside the given model.
    """

    def __init__(
        self,
        noise: EventNoise,
        kinds: Vocabulary,
        prior: Prior,
        catalogue: Sequence[Effect],
        seed: int,
        refitter: Refitter | None,
        limits: Sequence[Limit] = (),
    ) -> None:
        self.noise, self.kinds, self.catalogue = noise, kinds, tuple(catalogue)
        self.fitter = EventFitter(noise, kinds, prior, refitter)
        self.limits, self.rng = tuple(limits), np.random.default_rng(seed)

    def beside(self, model: Model) -> tuple[Limit, ...]:
        """The limits of a model: those of the given one, and what its edits did to them."""
        return self._after(model.edits)

    def _after(self, edits: Sequence[Insertion | Convention]) -> tuple[Limit, ...]:
        found = list(self.limits)
        for edit in edits:
            if isinstance(edit, LimitPlace) and edit.change == "add":
                found.append(edit.limit)
            elif isinstance(edit, LimitPlace):
                found.remove(edit.limit)
        return tuple(found)

    def given(self, diagram: Diagram) -> Model | None:
        """The given model from its nominal values and draws about them; beside a sweep from what that alone says, too."""
        try:
            misfit = self.fitter.misfit(diagram, self.limits)
        except IbridError:
            return None
        middle = misfit.beliefs.start({})
        width = np.minimum(misfit.beliefs.width(middle), 0.7)
        drawn = middle + 0.5 * width * self.rng.standard_normal((DRAWS, len(middle)))
        starts: list[Values] = [{}, *(misfit.values(one) for one in np.clip(drawn, *misfit.box))]
        if self.fitter.refitter is not None:
            small = self.fitter.refitter.refit(diagram, [{}], draws=16)
            starts += [] if small is None else [small.values]
        fit = self.fitter.fit(diagram, self.limits, starts, GIVEN, KEPT)
        return None if fit is None else Model(diagram, Convention(), fit)

    def refitted(self, model: Model, starts: Sequence[Values], *, draws: int = 0, spread: float = 0.7) -> Model | None:
        """A model fitted from starts."""
        fit = self.fitter.fit(model.diagram, self.beside(model), starts, WHOLE, KEPT)
        return None if fit is None else replace(model, refit=fit)

    def again(self, model: Model, starts: Sequence[Values]) -> Model:
        """A model fitted from further starts; the better of both."""
        other = self.refitted(model, starts)
        return model if other is None or other.refit.cost >= model.refit.cost else other

    def insertions(self, model: Model) -> tuple[Insertion, ...]:
        """Limits first, then all edits of the program."""
        limits = limit_places(model.diagram, self.kinds, self.beside(model), self.noise.events, given=self.limits)
        return (*limits, *insertions(model.diagram, self.kinds, self.catalogue))

    def edited(self, model: Model, insertion: Insertion, *, quick: Sequence[Values] = ()) -> Model | None:
        """A model with an edit, fitted from its own and from nominal values with strengths of the effect."""
        return self._edited(model, insertion, quick or (model.refit.values, {}), WHOLE, KEPT)

    def glanced(self, model: Model, insertion: Insertion, *, nominal: bool = True) -> Model | None:
        """A model with an edit after a step."""
        return self._edited(model, insertion, (model.refit.values, {}) if nominal else (model.refit.values,), GLANCE, 1)

    def _edited(
        self, model: Model, insertion: Insertion, origins: Sequence[Values], steps: int, kept: int
    ) -> Model | None:
        changed = replace(model, diagram=insertion.diagram, edits=(*model.edits, insertion))
        if isinstance(insertion, LimitPlace):
            starts = [{**values, **start} for start in insertion.starts for values in origins]
        else:
            starts = strengths(insertion, origins)
        own = [values for values in origins if all(name in values for name in insertion.parameters)]
        fit = self.fitter.fit(insertion.diagram, self.beside(changed), [*own, *starts], steps, kept)
        return None if fit is None else replace(changed, refit=fit)

    def read_otherwise(self, model: Model, enough: float) -> Iterator[Model]:
        """Not asked of records: their rest says p, q, v."""
        return iter(())

    def stable(self, model: Model) -> bool:
        """True for a model whose simulation stays in every record."""
        return bool(np.isfinite(model.refit.chi2))

    def known_stable(self, model: Model) -> bool | None:
        """The same: every fit has answered."""
        return self.stable(model)

    def ports(self, given: Model, steps: list[str], repaired: Model | None = None) -> tuple[PortFit, ...]:
        """() : no transfer stands for a limit."""
        return ()

    def held_out(self, model: Model) -> HeldOut | None:
        """Each record predicted from the others, where there are enough."""
        names, squares = self.noise.events.names, []
        if len(names) < FEWEST or not isinstance(model.refit, EventFit):
            return None
        for name in names:
            fit = self.fitter.of(without(self.noise, name)).fit(
                model.diagram, self.beside(model), [model.refit.values], GLANCE + 1
            )
            if fit is None:
                return HeldOut(None, None)
            left = self.fitter.of(without(self.noise, name, hold=True))
            misfit = left.misfit(model.diagram, self.beside(model))
            squares.append(float(np.mean(misfit.played(fit.x[None])[0] ** 2)))
        found = float(np.sqrt(np.mean(squares)))
        return HeldOut(None, found if np.isfinite(found) else None)
