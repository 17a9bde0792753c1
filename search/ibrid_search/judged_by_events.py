"""Which of the structures that a sweep cannot tell apart explains records of events, too."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import exp

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.joint_fit import weighed_by_events
from ibrid.measurement.events import Events
from ibrid.study import Study


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
    steps: Iterable[int], record_of: Callable[[int], Record], events: Events, study: Study
) -> list[Judged]:
    """The steps that have a rest in every record, the most likely first."""
    found = []
    for step in steps:
        try:
            record, bic = weighed_by_events(record_of(step), events, study)
        except IbridError:
            continue
        found.append(Judged(step, record, bic))
    return sorted(found, key=lambda one: one.bic)
