"""Which of the structures that a sweep cannot tell apart explains records of events, too."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import exp, log

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.event_question import asked
from ibrid.gap.joint_fit import weighed_by_events
from ibrid.measurement.events import Events
from ibrid.study import Study
from ibrid_search.rivals import MOST, ODDS, Rival, told_apart
from ibrid_search.step import Step


@dataclass(frozen=True, eq=False)
class Judged:
    """A step fitted to sweep and records together. `bic` : the Bayesian information criterion on all of them."""

    step: int
    record: Record
    bic: float

    def against(self, best: "Judged") -> dict[str, object]:
        """What selection.json says of it. odds : of the best against it."""
        odds = exp(min((self.bic - best.bic) / 2, 300.0))
        return {"step": self.step, "odds": odds, "nrmse_by_record": dict(self.record.nrmse_by_record)}


def judged_by_events(
    steps: Iterable[int],
    record_of: Callable[[int], Record],
    allowed: Callable[[Record], bool],
    events: Events,
    study: Study,
) -> list[Judged]:
    """The steps that have a rest in every record and are allowed as they are fitted to both, the most likely first."""
    found = []
    for step in steps:
        try:
            record, bic = weighed_by_events(asked(record_of(step), study, None, events, {}))
        except IbridError:
            continue
        if allowed(record):
            found.append(Judged(step, record, bic))
    return sorted(found, key=lambda one: one.bic)


def rivals_beside(judged: Sequence[Judged], steps: Sequence[Step]) -> tuple[Rival, ...]:
    """Those that sweep and records together leave within `ODDS` of the best, and the sweep that would tell."""
    best, *others = judged
    close = [one for one in others if one.bic - best.bic <= 2 * log(ODDS)][:MOST]
    return tuple(
        told_apart(
            Rival(one.step, one.record.free_parameters, exp((one.bic - best.bic) / 2), steps[one.step].note),
            best.record,
            one.record,
        )
        for one in close
    )
