"""What is done for one candidate: a quick fit from its parent's values, and a thorough one when that promises something."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.structure.program import parse_program
from ibrid.study import Study
from ibrid_search.evaluation.job import Job
from ibrid_search.merit import Floor, noise_floor

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
class Assessor:
    """What all jobs of a search share: the study, and the effort of a quick and of a thorough fit. It travels to workers."""

    study: Study
    quick: FitSettings = QUICK
    thorough: FitSettings = THOROUGH

    @cached_property
    def floor(self) -> Floor:
        """How errors are measured, and what noise leaves of them."""
        return noise_floor(self.study.fitted)

    def record_of(
        self, program: str, settings: FitSettings, warm: Mapping[str, Mapping[str, float]] | None = None
    ) -> Record:
        """The record of a program with a given effort, `warm` values tried beside the starts."""
        return evaluate(parse_program(program), self.study, settings=settings, warm=warm)

    def assess(self, job: Job) -> Record:
        """Fit a candidate quickly, and thoroughly when that promises something: an error below `job.promising`, with more
        free numbers than the parent's one that looks as if the fit had stopped in its minimum, or any where `promising` is
        None."""
        record = self.record_of(job.program, self.quick, job.warm)
        if record.outcome != Outcome.OK:
            return record
        if self._promises(record, job):
            again = self.record_of(job.program, self.thorough, record.parameters)
            if again.outcome == Outcome.OK and self.floor.error(again) <= self.floor.error(record):
                return replace(again, seconds=record.seconds + again.seconds)
        return record

    def _promises(self, record: Record, job: Job) -> bool:
        if job.promising is None:
            return True
        more = job.free_before is not None and record.free_parameters > job.free_before
        return self.floor.error(record) < job.promising * (STUCK if more else 1.0)
