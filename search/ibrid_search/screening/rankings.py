"""What a fitted candidate lacks, asked of the data once and remembered: its edits in the order of
what they explain.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import islice
from math import inf, isfinite, log

from ibrid.errors import IbridError
from ibrid.gap.ports.missing_transfer import measured
from ibrid.gap.ports.port_map import PortFit, port_map
from ibrid.gap.refitting.noise import noise_of
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import program_text
from ibrid.study import Study
from ibrid_search.evaluated import Evaluated
from ibrid_search.screening.diagnosis import (
    MOST_FREQUENCIES,
    MOST_POINTS,
    Edited,
    Looker,
    RankedEdit,
    Values,
    anywhere_of,
    effects_of,
    forms_of,
    frame_of,
    ideas_of,
    itself_of,
)
from ibrid_search.screening.event_looks import EventLooker
from ibrid_search.screening.merit import ABOVE_NOISE, GROSS, criterion
from ibrid_search.settings import SearchSettings

#: An error of a look up to which a fit may be exact.
LOOKED_EXACT = 1e-5
#: Gain in ln(error), prices paid, from which a look is proposed before more is looked at.
PROMISES = 0.7
#: The same for a layer of control that is missing.
STANDS = 0.2
#: Stages of a ranking that are about usual single edits.
SINGLE = 2
#: Single edits, of least error, from which pairs are looked at when no single one promises
#: anything.
AHEAD = 3
#: Pairs that are looked at after a glance at all.
LOOKED = 16
#: Ports that are told, and the part of the misfit that an unknown transfer there may leave.
PORTS, EXPLAINS = 3, 0.25
#: Lists of edits that are kept: a candidate is asked about more than once.
ASKED = 400


class Rankings:
    """The rankings of the candidates of one study (`ibrid_search.screening.diagnosis`)."""

    def __init__(self, study: Study, looker: Looker) -> None:
        self.study, self.looker = study, looker
        self._edits: dict[str, list[Edited]] = {}
        self._ports: dict[str, tuple[PortFit, ...]] = {}

    def best(
        self,
        parent: Evaluated,
        new: Callable[[Diagram], bool],
        number: int = 1,
        *,
        thorough: bool = True,
    ) -> list[RankedEdit]:
        """Edits of a candidate that lead to a structure which is `new`, at most so many, the best
        first.

        While the error is gross and a layer of control is missing, what puts one in comes first.
        Else effects of the catalogue are looked at first; where none promises half of what can be
        gained, other ideas, then two at once, then blocks and wires anywhere: these two where it is
        to be `thorough`, and noise leaves something to be found. Empty where no edit has a
        response.
        """
        error, floor = self._error(parent), self.looker.criterion.floor
        own = self.looker.worth(error, parent.record.free_parameters)
        enough = own - min(PROMISES, log(max(error / floor.most, 1.0)) / 2)
        if self._gross(parent):
            looks = self._ranked(parent.diagram, self._values(parent), frame_of)
            frame = [look for look in looks if look.worth < own - STANDS and new(look.edit.diagram)]
            if frame:
                return frame[:number]
        best: list[RankedEdit] = []
        for looks in islice(
            self._stages(parent), None if thorough and error > floor.most else SINGLE
        ):
            candidates = (look for look in looks if look.values and new(look.edit.diagram))
            best = sorted([*best, *islice(candidates, number)], key=lambda look: look.worth)[
                :number
            ]
            if best and best[0].worth < enough:
                break
        return best

    def ports(self, parent: Evaluated) -> tuple[PortFit, ...]:
        """The ports of a candidate at which one unknown transfer explains most of what is left
        (`port_map`), the best first, with that transfer at the parameters beside it.

        Empty where only noise is left, of records alone, and where operating points have values or
        frequencies of their own.
        """
        asked = (self.study.parameters, self.study.equilibrium, self.study.events) == (
            "shared",
            "exact",
            None,
        )
        if not asked or self._error(parent) <= self.looker.criterion.floor.most:
            return ()
        key = f"{program_text(parent.diagram)} {parent.record.nrmse}"
        if key not in self._ports:
            self._ports[key] = tuple(self._explaining(parent))
        return self._ports[key]

    def _explaining(self, parent: Evaluated) -> Iterator[PortFit]:
        noise, kinds = noise_of(self.study.fitted), self.study.kinds
        few = coarse(noise.sweep.points, MOST_POINTS, MOST_FREQUENCIES)
        noise = replace(noise, sweep=replace(noise.sweep, points=few))
        try:
            fits = port_map(
                self.study.placed(parent.diagram), kinds, noise.sweep, {}, self._values(parent)[:1]
            )
        except IbridError:  # grids that differ
            return
        left = (parent.record.misfit or {}).get("chi2_per_dof") or 0.0
        for fit in fits[:PORTS]:
            if fit.chi2_per_dof < EXPLAINS * left:
                transfer, deviation = measured(fit, kinds, noise, fit.values, 1.0 + fit.transfer)
                yield replace(fit, transfer=transfer, deviation=deviation)

    @cached_property
    def textbooks(self) -> tuple[RankedEdit, ...]:
        """First looks at the shipped diagrams of one device."""
        return self.looker.textbooks()

    def loss(self, parent: Evaluated, without: Diagram) -> float:
        """What a removal loses by looks: in free numbers, less those saved, where a sweep tells its
        noise; else in ln(error).
        """
        looker, values, study = self.looker, self._values(parent), self.study
        less, floor = (
            next(iter(looker.ranked(itself_of(without, study), values)), None),
            looker.criterion.floor,
        )
        if less is None:  # without it no record has an answer
            return inf
        counted = floor.known and study.events is None
        own = looker.ranked(itself_of(parent.diagram, study), values)[0] if counted else None
        if own is not None and isfinite(own.error):
            return log(less.error / own.error) / looker.price + less.free - own.free
        least = floor.most if floor.known else LOOKED_EXACT
        return log(max(less.error, least) / max(self._error(parent), least))

    def _gross(self, parent: Evaluated) -> bool:
        return self._error(parent) > max(GROSS, ABOVE_NOISE * self.looker.criterion.floor.level)

    def _error(self, parent: Evaluated) -> float:
        return self.looker.criterion.floor.error(parent.record)

    def _stages(self, parent: Evaluated) -> Iterator[list[RankedEdit]]:
        """Looks at effects, with forms of delays once the error is not gross; at other ideas, at
        pairs, at blocks and wires anywhere; each the best first. Of records alone, where a race
        takes a minute, only the first two.
        """
        diagram, values = parent.diagram, self._values(parent)
        settled = self._error(parent) <= self.looker.criterion.floor.most
        effects = self._ranked(diagram, values, effects_of, settled)
        forms = [] if self._gross(parent) else self._ranked(diagram, values, forms_of, settled)
        yield sorted([*effects, *forms], key=lambda look: look.worth)
        yield (ideas := self._ranked(diagram, values, ideas_of, settled))
        if self.study.events is not None:
            return
        yield self._pairs(sorted([*effects, *ideas], key=lambda look: look.error)[:AHEAD])
        yield self._ranked(diagram, values, anywhere_of)

    def _pairs(self, firsts: Sequence[RankedEdit]) -> list[RankedEdit]:
        """Looks at effects on top of looks: at those that a glance finds best."""
        pairs = []
        for first in firsts:
            for edit in effects_of(first.edit.diagram, self.study):
                words, part = (
                    f"{first.edit.words}; {edit.words}",
                    f"{first.edit.part} + {edit.part}",
                )
                pairs.append((replace(edit, words=words, part=part), first.values))
        self.looker.stage(pairs)
        glances = [(self.looker.look(both, values, glance=True), values) for both, values in pairs]
        best = sorted(glances, key=lambda one: one[0].worth)[:LOOKED]
        self.looker.stage(best)
        return sorted(
            (self.looker.look(glance.edit, values) for glance, values in best),
            key=lambda look: look.worth,
        )

    def _values(self, parent: Evaluated) -> Values:
        return [parent.record.parameters[name] for name in self.study.fitted.names]

    def _ranked(
        self,
        diagram: Diagram,
        values: Values,
        edits: Callable[[Diagram, Study], list[Edited]],
        settled: bool = False,
    ) -> list[RankedEdit]:
        """Edits of a diagram with fitted values, by looks; settled : it leaves nothing but
        noise.
        """
        key = f"{edits.__name__} {program_text(diagram)}"
        if key not in self._edits:
            if len(self._edits) >= ASKED:
                self._edits.clear()
            self._edits[key] = edits(diagram, self.study)
        return self.looker.ranked(self._edits[key], values, settled=settled)


@lru_cache(maxsize=2)
def rankings_of(study: Study) -> Rankings:
    """The rankings of a study, the same for whoever asks."""
    return Rankings(
        study,
        (Looker if study.events is None else EventLooker)(
            study, criterion(study, SearchSettings())
        ),
    )
