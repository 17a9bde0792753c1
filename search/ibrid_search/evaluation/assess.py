"""What is done for one candidate: a quick fit from its parent's values, and a thorough one when that promises something."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf

from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.sweep import Sweep
from ibrid.modules.vocabulary import VOCABULARY, Vocabulary
from ibrid.structure.program import parse_program
from ibrid_search.evaluation.job import Job
from ibrid_search.merit import Floor

#: Limit of a fit (s): far above the wall limit of a candidate, which alone stops it, so that load changes no score.
BY_THE_WALL = 3600.0
#: Most candidates get this: one wave of few starts, and the parent's values.
QUICK = FitSettings(starts=64, kept=5, kept_misfit=5, restarts=0, hops=0, seconds=BY_THE_WALL)
#: What promises something gets this on top.
THOROUGH = FitSettings(starts=64, kept=6, kept_misfit=8, restarts=1, hops=2, kicked=16, seconds=BY_THE_WALL)
#: An error below this part of its parent's promises something.
PROMISING = 0.99
#: With more free numbers than the parent has an error up to this factor above that part does too, 1 % above the parent's: the
#: quick fit of the right edit often stops in the parent's minimum.
STUCK = 1.02


@dataclass(frozen=True)
class Subject:
    """What all jobs of a search share: data, physics, the effort of the quick and the thorough fit. It travels to workers.

    `floor` : how errors are measured; None: NRMSE.
    """

    sweep: Sweep
    parameters: str = "shared"
    equilibrium: str = "exact"
    kinds: Vocabulary = VOCABULARY
    holdout_op: tuple[str, ...] = ()
    fit: FitSettings = QUICK
    thorough: FitSettings = THOROUGH
    seed: int = 0
    floor: Floor | None = None

    def error(self, record: Record) -> float:
        """What candidates are compared by."""
        if self.floor is not None:
            return self.floor.error(record)
        return inf if record.nrmse is None else record.nrmse

    def record_of(
        self, program: str, settings: FitSettings, warm: Mapping[str, Mapping[str, float]] | None = None
    ) -> Record:
        """The record of a program with a given effort, `warm` values tried beside the starts."""
        return evaluate(
            parse_program(program),
            self.sweep,
            parameters=self.parameters,
            equilibrium=self.equilibrium,
            vocabulary=self.kinds,
            holdout_op=self.holdout_op,
            seed=self.seed,
            settings=settings,
            warm=warm,
        )


def assess(job: Job, subject: Subject) -> Record:
    """Fit a candidate quickly, and thoroughly when that promises something: an error below `job.promising`, with more free
    numbers than the parent's one that looks as if the fit had stopped in its minimum, or any where `promising` is None."""
    record = subject.record_of(job.program, subject.fit, job.warm)
    if record.outcome != Outcome.OK:
        return record
    if _promises(record, job, subject):
        again = subject.record_of(job.program, subject.thorough, record.parameters)
        if again.outcome == Outcome.OK and subject.error(again) <= subject.error(record):
            return replace(again, seconds=record.seconds + again.seconds)
    return record


def _promises(record: Record, job: Job, subject: Subject) -> bool:
    if job.promising is None:
        return True
    more = job.free_before is not None and record.free_parameters > job.free_before
    return subject.error(record) < job.promising * (STUCK if more else 1.0)
