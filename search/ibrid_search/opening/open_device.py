"""Open a device: measure, identify, measure what tells most, and predict what no fit saw."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from ibrid.devices.device_file import DeviceFile, read_device
from ibrid.devices.isolation.child import plain_device
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.fit.settings import require_one_of
from ibrid.gap.workflow import find_gap
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.own_files import also_reading, writing_as
from ibrid.telling import Tell, silent
from ibrid.writing import inside, require_folder, write_whole
from ibrid_search.opening.device_data import join_events, join_measurements, measure_experiment
from ibrid_search.opening.page import PAGE, RECORDINGS, write_page
from ibrid_search.opening.planning import (
    COARSE,
    DEEP,
    choose_experiment,
    coarse_sweeps,
    deep_dip,
    held_out_experiments,
)
from ibrid_search.opening.predicting import played_error, prediction_error
from ibrid_search.opening.story import STORY, DeviceExperiment, OpeningStory, digest_of, read_story
from ibrid_search.opening.structures import (
    Structures,
    names_gone,
    refit_structures,
    search_structures,
)
from ibrid_search.run.run_folder import require_no_run

#: Evaluations of a search, by effort.
EVALUATIONS = {"low": 15, "normal": 100, "high": 400}
#: Experiments that are held out.
HELD_OUT = 3
#: Searches at most: another one follows where new data are not explained.
SEARCHES = 3
#: Error in a deep dip above which something acts that the sweep does not show.
MISSED = 0.05
MODEL, RECORD = "model.py", "model.json"
FILES = (STORY, MODEL, RECORD, PAGE, RECORDINGS)
EXPLAINED = "explains"


@hearing_interrupts()
@writing_as("open")
def open_device(
    device: str | Path | DeviceFile,
    folder: str | Path,
    *,
    points: Sequence[str] = (),
    budget: int = 8,
    gain: float = 1.0,
    effort: str = "normal",
    seed: int = 0,
    resume: bool = False,
    tell: Tell = silent,
) -> OpeningStory:
    """Identify a device by experiments that are chosen while it is measured.

    Parameters
    ----------
    points : operating points of the coarse sweep, two where none are named.
    budget : experiments at most, the coarse ones included; the three that are held out come on
        top.
    gain : bits that an experiment must promise (`planning.choose_experiment`).
    effort : of each search, one of `EVALUATIONS`.

    Returns the story, which story.json and report.html in the folder tell.

    Raises
    ------
    IbridError : a device that cannot be measured at the first points, a budget that these use up,
        or a folder that holds something else.
    """
    require_one_of("effort", effort, tuple(EVALUATIONS))
    file = device if isinstance(device, DeviceFile) else read_device(device)
    points = tuple(points) or COARSE
    if budget < len(points):
        raise IbridError(
            f"--budget must be {len(points)} experiments or more, which the coarse sweep takes; "
            f"found {budget}"
        )
    if not gain > 0:
        raise IbridError(f"--gain must be a number of bits above 0; found {gain:g}")
    folder = Path(folder)
    also_reading({"the model file": file.path})
    key = _key(file, points, gain, effort, seed)
    story = _begun(folder, file, key, resume)
    folder.mkdir(parents=True, exist_ok=True)
    is_told = len(story.held_out) == HELD_OUT and inside(folder, PAGE).is_file()
    if is_told and budget <= len(story.experiments):
        return story
    return _Opening(file, folder, points, budget, gain, effort, seed, tell, story).run()


class _Opening:
    """The loop, begun anew or gone on with: measurements are kept, and what follows from them is
    the same each time.
    """

    def __init__(
        self,
        device: DeviceFile,
        folder: Path,
        points: Sequence[str],
        budget: int,
        gain: float,
        effort: str,
        seed: int,
        tell: Tell,
        story: OpeningStory,
    ) -> None:
        self.device = device
        self.folder = folder
        self.points = points
        self.budget = budget
        self.gain = gain
        self.effort = effort
        self.seed = seed
        self.tell = tell
        self.kept = story.experiments
        settings = {
            "points": list(points),
            "budget": budget,
            "gain": gain,
            "effort": effort,
            "evaluations": EVALUATIONS[effort],
            "seed": seed,
        }
        self.story = replace(story, experiments=(), ending="", answer={}, settings=settings)
        self.searches = 0

    def run(self) -> OpeningStory:
        """Go through all of it."""
        for experiment in coarse_sweeps(self.device, self.points):
            self._measure(experiment, must=True)
        known = self._identify()
        limits: dict[str, Any] = {}
        ending = ""
        while not ending:
            left = self.budget - len(self.story.experiments)
            is_settled = known.answer.grade == EXPLAINED and len(known.names) == 1
            dipped = any(one.event == DEEP for one in self.story.experiments)
            if left <= 0:
                ending = f"the budget of {self.budget} experiments is used"
            elif is_settled and dipped:
                ending = "the answer explains all sweeps, and no rival is left"
            elif is_settled or (left == 1 and not dipped):
                self._measure(deep_dip(self.points[0]))
                known, limits = self._find_limits(known)
            else:
                done = self.story.experiments
                plan = choose_experiment(self.device, known, done, self.points, self.gain)
                if plan.experiment is not None:
                    self._measure(plan.experiment)
                    known = self._narrow(known)
                elif dipped:
                    ending = plan.ending
                else:
                    self._measure(deep_dip(self.points[0]))
                    known, limits = self._find_limits(known)
                    ending = plan.ending
        return self._conclude(known, limits, ending)

    def _measure(self, experiment: DeviceExperiment, *, must: bool = False) -> None:
        """Measure an experiment, or take what was kept of it; a refusal of the device is told."""
        number = len(self.story.experiments)
        if number < len(self.kept) and _same(self.kept[number], experiment):
            done = self.kept[number]
        else:
            self.kept = ()
            heard = partial(self._heard, f"experiment {number + 1}")
            try:
                done = measure_experiment(
                    self.device, experiment, self.folder, f"{experiment.kind}_{number + 1}", heard
                )
            except IbridError as error:
                if must:
                    raise
                done = replace(experiment, refused=str(error))
        self._tell_story(replace(self.story, experiments=(*self.story.experiments, done)))

    def _heard(self, what: str, words: str, share: float) -> None:
        done = len(self.story.experiments)
        self.tell(f"{what}: {words}", min((done + share) / (self.budget + 3), 1.0))

    def _tell_story(self, story: OpeningStory) -> None:
        """Keep the story, with those experiments that are not come to yet again."""
        self.story = story
        rest = self.kept[len(story.experiments) :]
        replace(story, experiments=(*story.experiments, *rest)).write(self.folder)

    def _identify(self) -> Structures:
        """The first answer, and what the search ruled out."""
        known = self._search()
        self._note_answer(known, known.ruled_out)
        return known

    def _data(self) -> tuple[Sweep, Events | None]:
        """All that was measured for fits."""
        return join_measurements(self.story.experiments, self.folder, self.device.step_s)

    def _search(self) -> Structures:
        sweep, _ = self._data()
        self.searches += 1
        heard = partial(self._heard, f"search {self.searches}")
        folder = self.folder / f"search_{self.searches}"
        return search_structures(sweep, folder, EVALUATIONS[self.effort], self.seed, heard)

    def _narrow(self, known: Structures) -> Structures:
        """The structures that the newest experiment leaves; searched anew where none explains."""
        newest = self.story.experiments[-1]
        if newest.refused:
            return known
        sweep, events = self._data()
        heard = partial(self._heard, "identification")
        left = refit_structures(known, sweep, events, lambda name: heard(f"fits {name}", 0.5))
        excluded = list(left.ruled_out)
        explains = left.answer.grade == EXPLAINED
        if not explains and newest.kind == "sweep" and self.searches < SEARCHES:
            found = self._search()
            gone = names_gone(left.names, found.names)
            excluded += [f"{name}: does not explain the new sweep" for name in gone]
            left = found
        self._note_answer(left, excluded)
        return left

    def _find_limits(self, known: Structures) -> tuple[Structures, dict[str, Any]]:
        """What a deep dip shows that the sweep does not."""
        newest = self.story.experiments[-1]
        if newest.refused:
            return known, {"sentence": f"not known: {newest.refused}"}
        events = read_events(self.folder / newest.file)
        try:
            error = played_error(known.answer, events)
        except IbridError:
            error = None
        if error is not None and error < MISSED:
            sentence = f"no limit acts in {newest.event}: the answer predicts it to {error:.2g}"
            self._note_answer(known, [sentence])
            return known, {"sentence": sentence, "nrmse": error}
        sweep, _ = self._data()
        self._heard("limits", "what is missing", 0.5)
        try:
            gap = find_gap(
                known.answer,
                sweep,
                events=events,
                progress="silent",
                effort=self.effort,
                labels="exact",
            )
        except IbridError as problem:
            sentence = f"the answer misses {newest.event}, and no limit was named: {problem}"
            self._note_answer(known, [sentence])
            return known, {"sentence": sentence, "nrmse": error}
        self._note_answer(known, [gap.sentence])
        told = {"sentence": gap.sentence, "nrmse": error, "verdict": str(gap.verdict)}
        limits = limits_of(gap.repaired)
        if not limits or gap.verdict != "named":  # what does not explain the dip spoils the answer
            return known, told
        with_limits = Structures(known.names, (gap.repaired, *known.records[1:]), known.ruled_out)
        return with_limits, {**told, "limits": limits}

    def _note_answer(self, known: Structures, excluded: Sequence[str]) -> None:
        """Write into the newest experiment what followed from it."""
        *before, newest = self.story.experiments
        answer = known.answer
        newest = replace(
            newest,
            ruled_out=tuple(excluded),
            answer=answer.program,
            grade=answer.grade or "",
            nrmse=answer.nrmse,
        )
        self._tell_story(replace(self.story, experiments=(*before, newest)))

    def _conclude(self, known: Structures, limits: dict[str, Any], ending: str) -> OpeningStory:
        """Write the answer and predict what no fit saw."""
        answer = known.answer
        write_whole(inside(self.folder, MODEL), answer.program)
        answer.write(inside(self.folder, RECORD))
        told = {
            "program": answer.program,
            "grade": answer.grade,
            "nrmse": answer.nrmse,
            "rivals": list(known.names[1:]),
            "limits": limits,
            "model": MODEL,
            "record": RECORD,
        }
        self.kept = ()
        measured_before = self.story.held_out
        self._tell_story(replace(self.story, ending=ending, answer=told, held_out={}))
        for experiment in held_out_experiments(self.device, self.story.experiments):
            name = "step" if experiment.event.startswith(("p_ref", "step")) else experiment.kind
            earlier = measured_before.get(name, {})
            predicted = self._predict(answer, experiment, name, earlier)
            self._tell_story(replace(self.story, held_out={**self.story.held_out, name: predicted}))
        self._write_recordings()
        sweep, _ = self._data()
        write_page(self.story, answer, sweep, self.folder)
        return self.story

    def _write_recordings(self) -> None:
        """Write all recordings, the held-out ones too, as one file for other commands."""
        kept = [experiment for experiment in self.story.experiments if experiment.kind == "event"]
        names = [experiment.file for experiment in kept if experiment.file]
        names += [self.story.held_out[name].get("file", "") for name in ("event", "step")]
        files = [self.folder / name for name in filter(None, names)]
        if files:
            write_events(join_events(files), inside(self.folder, RECORDINGS))

    def _predict(
        self,
        answer: Record,
        experiment: DeviceExperiment,
        name: str,
        earlier: Mapping[str, Any],
    ) -> dict[str, Any]:
        """A held-out experiment, and the error of the answer in it.

        earlier : what was kept of it, whose measurement is taken again.
        """
        told = {"op": experiment.op, "event": experiment.event, "nrmse": None, "refused": ""}
        file = self.folder / f"held_out_{name}.csv"
        if _is_kept(earlier, experiment, file):
            told |= {key: earlier[key] for key in ("file", "sha256", "simulated_s")}
        else:
            heard = partial(self._heard, f"held-out {name}")
            try:
                done = measure_experiment(
                    self.device, experiment, self.folder, f"held_out_{name}", heard
                )
            except IbridError as problem:
                return {**told, "refused": f"not measured: {problem}"}
            told |= {"file": done.file, "sha256": done.sha256, "simulated_s": done.simulated_s}
        try:
            error = prediction_error(answer, file, experiment.kind)
            return {**told, "nrmse": error}
        except IbridError as problem:
            return {**told, "refused": f"the model has no answer: {problem}"}


def limits_of(record: Record) -> dict[str, dict[str, float]]:
    """The limits of a record by id, each with its parameters; what JSON carries."""
    found = record.settings.get("large_signal") or ()
    return {one["id"]: {name: float(x) for name, x in one["parameters"].items()} for one in found}


def _is_kept(earlier: Mapping[str, Any], asked: DeviceExperiment, file: Path) -> bool:
    """Whether a file holds the held-out experiment that is asked for."""
    is_same = (earlier.get("op"), earlier.get("event")) == (asked.op, asked.event)
    return is_same and bool(earlier.get("file")) and digest_of(file) == earlier["sha256"]


def _same(kept: DeviceExperiment, asked: DeviceExperiment) -> bool:
    """Whether what was measured is what is asked for."""
    first, second = ((one.kind, one.op, one.event, one.frequencies) for one in (kept, asked))
    return first == second


def _begun(folder: Path, device: DeviceFile, key: str, resume: bool) -> OpeningStory:
    """A new story, or the one that is gone on with."""
    if resume:
        story = read_story(folder)
        if story.key != key:
            raise IbridError(
                f"{folder}: holds the story of another device, model file or settings; begin in "
                "another folder, or go on with the same options"
            )
        return story
    require_no_run(folder)
    if inside(folder, STORY).exists():
        raise IbridError(
            f"{folder}: holds a story already; go on with it by --resume, or choose another folder"
        )
    require_folder(folder, FILES)
    return OpeningStory(key, Path(device.file).name)


def _key(device: DeviceFile, points: Sequence[str], gain: float, effort: str, seed: int) -> str:
    """Hash of what the measurements depend on; the budget is not among it: a larger one goes on."""
    told = [plain_device(device), list(points), gain, effort, seed, digest_of(device.path)]
    return sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
