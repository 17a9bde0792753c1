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
from search.evaluation.job import Job
from search.merit import Floor

#: Limit of a fit (s): far above the wall limit of a candidate, which alone stops it, so that load changes no score.
BY_THE_WALL = 3600.0
#: Most candidates get this: one wave of few starts, and the parent's values.
QUICK = FitSettings(starts=64, kept=5, kept_misfit=5, restarts=0, hops=0, seconds=BY_THE_WALL)
#: What promises something gets this on top.
THOROUGH = FitSettings(starts=64, kept=6, kept_misfit=8, restarts=1, hops=2, kicked=16, seconds=BY_THE_WALL)
#: An error below this many times its parent's promises something: a quick fit of the right edit often stops in the parent's
#: minimum.
PROMISING = 1.01


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
    """Fit a candidate quickly, and thoroughly when its error comes out below `job.promising`, or that is None.

    A quick fit may stop in the parent's minimum, although the edit is the right one.
    """
    record = subject.record_of(job.program, subject.fit, job.warm)
    if record.outcome != Outcome.OK:
        return record
    if job.promising is None or subject.error(record) < job.promising:
        again = subject.record_of(job.program, subject.thorough, record.parameters)
        if again.outcome == Outcome.OK and subject.error(again) <= subject.error(record):
            return replace(again, seconds=record.seconds + again.seconds)
    return record
