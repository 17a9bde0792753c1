"""What is done for one candidate: a quick fit from its parent's values, and a thorough one when
that promises something.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import BETTER
from ibrid.fit.settings import FIT_EFFORTS, FitSettings
from ibrid.gap.recordings.event_evaluation import evaluate_records
from ibrid.measurement.sweeps.amplitudes import coarse
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.diagrams.program import parse_program
from ibrid.study import Study
from ibrid_search.evaluation.job import Job
from ibrid_search.screening.selection_criterion import NoiseFloor, estimate_study_noise_floor

#: Most candidates get this: one wave of few starts, and the parent's values.
QUICK = FitSettings(starts=64, kept=5, kept_misfit=5, restarts=0, hops=0)
#: What promises something gets this on top.
THOROUGH = FitSettings(starts=64, kept=6, kept_misfit=8, restarts=1, hops=2, kicked=16)
#: Of more numbers than so many frequencies, starts descend on few: so many operating points with so
#: many frequencies each.
MANY, MOST_POINTS, MOST_FREQUENCIES = 400, 4, 40
#: The last part of a descent, on all data.
POLISH = FitSettings(starts=8, kept=1, kept_misfit=1, restarts=0, hops=0, warm=1, warm_kept=1)
#: By the effort of a search: of a quick fit, of a thorough one, and of the last fit of what may be
#: the answer.
EFFORTS: Mapping[str, tuple[FitSettings, FitSettings, FitSettings]] = MappingProxyType(
    {
        "low": (QUICK, replace(THOROUGH, restarts=0, hops=1), THOROUGH),
        "normal": (QUICK, THOROUGH, FIT_EFFORTS["normal"]),
        "high": (THOROUGH, FIT_EFFORTS["normal"], FIT_EFFORTS["high"]),
    }
)


@dataclass(frozen=True)
class Assessor:
    """What all jobs of a search share: the study, and the effort of a quick and of a thorough fit.
    It travels to workers.

    `whole` : effort of the last fit of what may be the answer.
    """

    study: Study
    quick: FitSettings = QUICK
    thorough: FitSettings = THOROUGH
    whole: FitSettings = FIT_EFFORTS["normal"]

    @classmethod
    def of(cls, study: Study, effort: str) -> "Assessor":
        """With the fits of an effort by its name, one of `EFFORTS`."""
        return cls(study, *EFFORTS[effort])

    @property
    def kinds(self) -> Vocabulary:
        """Of the records that it makes."""
        return self.study.kinds

    def arrived(self) -> "Assessor":
        """The same with frozen arrays: pickled ones come back writeable, for which the kernel would
        be compiled once more.
        """
        study = self.study
        frozen = replace(study.sweep, points=tuple(replace(point) for point in study.sweep.points))
        return replace(self, study=replace(study, sweep=frozen))

    @cached_property
    def floor(self) -> NoiseFloor:
        """How errors are measured, and what noise leaves of them."""
        return estimate_study_noise_floor(self.study)

    def record_of(
        self,
        program: str,
        settings: FitSettings,
        warm: Mapping[str, Mapping[str, float]] | None = None,
    ) -> Record:
        """The record of a program with a given effort, `warm` values tried beside the starts; of
        much data it is spent on few, and what it finds is polished on all.
        """
        diagram = parse_program(program)
        if self.study.events is not None:
            return evaluate_records(diagram, self.study, settings, warm)
        if self._few is None:
            return evaluate(diagram, self.study, settings=settings, warm=warm)
        first = evaluate(diagram, self._few, settings=settings, warm=warm)
        if first.outcome != Outcome.OK:
            return first
        typical = next(iter(first.parameters.values()))
        known = {name: first.parameters.get(name, typical) for name in self.study.fitted.names}
        whole = evaluate(diagram, self.study, settings=POLISH, warm=known)
        return replace(whole, seconds=first.seconds + whole.seconds)

    @cached_property
    def _few(self) -> Study | None:
        """The study with few of its data; None where there are not many.

        A point with numbers of its own is never left out.
        """
        fitted = self.study.fitted
        if sum(len(point.frequency) for point in fitted.points) <= MANY:
            return None
        most = MOST_POINTS if self.study.parameters == "shared" else len(fitted.points)
        few = replace(fitted, points=coarse(fitted.points, most, MOST_FREQUENCIES))
        return replace(self.study, sweep=few, holdout_op=())

    def assess(self, job: Job) -> Record:
        """Fit a candidate quickly, and thoroughly when that promises something: an error below
        `job.promising`, with more free numbers than the parent's one that looks as if the fit had
        stopped in its minimum, or any where `promising` is None.
        """
        record = self.record_of(job.program, self.quick, job.warm)
        if record.outcome != Outcome.OK:
            return record
        if self._promises(record, job):
            again = self.record_of(job.program, self.thorough, record.parameters)
            if again.outcome == Outcome.OK and self.floor.error_of(again) <= self.floor.error_of(
                record
            ):
                return replace(again, seconds=record.seconds + again.seconds)
        return record

    def _promises(self, record: Record, job: Job) -> bool:
        if job.promising is None:
            return True
        more = job.free_before is not None and record.free_parameters > job.free_before
        return self.floor.error_of(record) < job.promising * (BETTER.stuck if more else 1.0)
