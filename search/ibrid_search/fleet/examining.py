"""What a worker does with one device: read its file, look at the structures of its fleet first,
then start, search or drift.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from math import inf
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

from ibrid.analysis.new_data.drift import drift
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.grade import Grade
from ibrid.evaluation.record import Record
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import VOCABULARY, Vocabulary
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.library import shipped_names, textbook
from ibrid.structure.diagrams.program import parse_program
from ibrid.study import Study
from ibrid_search.archives.appraisal import sort_of_control
from ibrid_search.archives.prior import Prior, joined
from ibrid_search.evaluation.assess import QUICK
from ibrid_search.evaluation.job import Job
from ibrid_search.running import search
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.edit_screening import EditScreener, ScreeningFit
from ibrid_search.screening.selection_criterion import build_criterion
from ibrid_search.settings import SearchSettings
from ibrid_search.starting.control_families import describe_family
from ibrid_search.starting.start import start

#: What can be done for each device.
JOBS = ("start", "search", "drift")
#: Structures of the fleet that are looked at, the commonest first, and of them those that are
#: fitted.
LOOKED_AT, FITTED = 12, 2
#: Difference of the looks' worth, of ln(error), from which the second is not fitted where the first
#: explains the data.
CLEAR = 0.2


@dataclass(frozen=True)
class DeviceJob(Job):
    """A device. `name` : its file. `content` : bytes of that. `before` : JSON of its record in an
    earlier fleet.
    """

    name: str = ""
    content: bytes = b""
    prior: Prior = field(default_factory=Prior)
    before: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Examiner:
    """What all jobs of a fleet share.

    `job` : one of `JOBS`. `budget` : evaluations of each search. `effort` : of each start or
    search.
    """

    job: str = "start"
    seed: int = 0
    budget: int = 40
    effort: str = "normal"

    @property
    def kinds(self) -> Vocabulary:
        """Of the records."""
        return VOCABULARY

    def arrived(self) -> "Examiner":
        """The same: it holds no arrays."""
        return self

    def assess(self, job: DeviceJob) -> Record:
        """The record of the device, whose settings tell under `fleet` what was done, `prior` what
        was known before the data, and under `drift` what changed. Raises IbridError, one sentence,
        for a file that is no sweep or that nothing explains.
        """
        sweep = read_device(job)
        if self.job == "drift":
            before = Record.from_json(job.before)
            return replace(
                before, settings={**before.settings, "drift": drift(before, sweep).plain()}
            )
        study = Study(sweep, seed=self.seed)
        record = _of_the_fleet(
            EditScreener(study, build_criterion(study, SearchSettings())), job.prior
        )
        expected = record is not None
        if record is None:
            record = self._examined(study)
        return told(record, study, job.prior, expected)

    def _examined(self, study: Study) -> Record:
        if self.job == "start":
            record = start(
                study.sweep, tell=lambda words, share: None, seed=self.seed, effort=self.effort
            ).best.record
        else:
            with TemporaryDirectory() as folder:
                settings = SearchSettings(effort=self.effort)
                run = Path(folder) / "run"
                result = search(
                    study.sweep,
                    run,
                    budget=self.budget,
                    seed=self.seed,
                    settings=settings,
                    progress="silent",
                )
            record = result.best
        if record is None:
            raise IbridError(
                "nothing that ships has a fit to these data; look at the file with ibrid inspect"
            )
        return record


def read_device(job: DeviceJob) -> Sweep:
    """The sweep of a device's file; IbridError under the user's name of it, whatever is in that."""
    with TemporaryDirectory() as folder:
        suffix = PurePath(job.name).suffix
        file = Path(folder) / f"device{suffix if suffix[1:].isalnum() else ''}"
        file.write_bytes(job.content)
        try:
            return replace(read_sweep(file), source=job.name)
        except IbridError as error:
            raise IbridError(str(error).replace(str(file), job.name)) from None


def _of_the_fleet(screener: EditScreener, prior: Prior) -> Record | None:
    """The most plausible fit of a structure that the fleet has already, from its typical values;
    None unless it explains the data: then the device is asked as if it were the only one.
    """
    study, measure = screener.study, screener.criterion
    looks: list[ScreeningFit] = []
    for family in prior.families[:LOOKED_AT]:
        edit = CandidateEdit(parse_program(family.program), family.label, family.label, {})
        looks.append(screener.screen_from_scratch(edit, family.values))
    looks.sort(key=lambda look: look.score)
    fitted: list[Record] = []
    for look in looks[:FITTED]:
        if look.error == inf or (
            fitted and fitted[0].grade == Grade.EXPLAINS and look.score > looks[0].score + CLEAR
        ):
            break
        warm = dict(zip(study.fitted.names, look.values, strict=True))
        fitted.append(evaluate(look.edit.diagram, study, settings=QUICK, warm=warm))
    explained = [one for one in fitted if one.grade == Grade.EXPLAINS]
    return min(
        explained,
        key=lambda one: measure.score(measure.floor.error_of(one), one.free_parameters),
        default=None,
    )


def told(record: Record, study: Study, prior: Prior, expected: bool) -> Record:
    """The record with what it owes to its fleet.

    `expected` : its structure was among those of the prior.
    """
    structure = structure_hash(record.diagram, study.kinds)
    family = prior.of(structure)
    own = {
        "structure": structure,
        "diagram": _labels().get(structure, f"structure {structure[:8]}"),
        "family": describe_family(sort_of_control(record.diagram, study.kinds)),
        "expected": expected,
    }
    known: dict[str, Any] = {"devices": prior.devices}
    if family is not None:
        typical = {name: list(pair) for name, pair in family.typical.items()}
        known |= {
            "of_the_family": family.devices,
            "typical": typical,
            "joined": joined(record, family),
        }
    return replace(record, settings={**record.settings, "fleet": own, "prior": known})


@cache
def _labels() -> Mapping[str, str]:
    """Structure -> name of the shipped diagram."""
    return {structure_hash(textbook(name), VOCABULARY): name for name in reversed(shipped_names())}
