"""Everything that the page about a run needs, read once: steps, records, data, the selection and
the given truth.
"""

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.record import Record, read_record
from ibrid.foreign_data import toml_in
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import NAMED_VOCABULARIES, VOCABULARY
from ibrid.structure.comparison.compare import Comparison, compare
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.study import Study
from ibrid.writing import inside
from ibrid_search.run.parsed import mapping_in
from ibrid_search.run.run_folder import BEST_RECORD, SELECTION
from ibrid_search.run.selection import Selection, plain_selection, read_selection
from ibrid_search.run.store import NotedCall, Store
from ibrid_search.run.trajectory import Milestone, Point, eligible, milestones, trajectory
from ibrid_search.screening.selection_criterion import (
    UNKNOWN_NOISE,
    NoiseFloor,
    estimate_study_noise_floor,
)
from ibrid_search.screening.settings import SCREENING
from ibrid_search.step import Step, line

Data = TypeVar("Data", Sweep, Events)


@dataclass(frozen=True)
class RunData:
    """A run as it stands.

    `kinds` : its vocabulary. `records` : step -> record, of the start, the answer and the
    milestones with their parents.
    `answer` : the step that is shown as found, None before the first valid one. `truth_record` :
    the given truth, fitted to the same data with the same options. `retried` : steps that were
    begun more than once, and how often. `archive` : its statistics, once the search has ended.
    `notes` : what could not be had, in sentences. `calls` : of the tools of an agent. `final` : the
    record in best.json, where it is of the answer.
    """

    meta: Mapping[str, str]
    settings: Mapping[str, Any]
    kinds: tuple[ModuleKind, ...]
    steps: Mapping[int, Step]
    records: Mapping[int, Record]
    points: tuple[Point, ...]
    milestones: tuple[Milestone, ...]
    sweep: Sweep | None
    events: Events | None
    selection: Selection
    answer: Step | None
    truth: Diagram | None
    truth_record: Record | None
    retried: Mapping[int, int]
    archive: Mapping[str, Any]
    notes: tuple[str, ...]
    calls: tuple[NotedCall, ...] = ()
    final: Record | None = None

    @property
    def start(self) -> Step | None:
        """What the answer's line begins with: step 0 or a further shipped diagram."""
        return (
            next(iter(line(self.steps, self.answer.number)), None)
            if self.answer
            else self.steps.get(0)
        )

    @property
    def record(self) -> Record | None:
        """The record of the answer."""
        return None if self.answer is None else self.records.get(self.answer.number)

    @cached_property
    def floor(self) -> NoiseFloor | None:
        """What the noise of the fitted points leaves of an error; None without data."""
        data = self.sweep or self.events
        if data is None:
            return None
        held = [one for one in self.settings.get("holdout_op", ()) if one in data.names]
        return estimate_study_noise_floor(Study.of(data, holdout_op=held))

    @cached_property
    def explained(self) -> bool:
        """True when a stable candidate follows the data down to their noise; exactly, where that is
        not known.
        """
        floor = self.floor or NoiseFloor(SCREENING.exact_error, 1, UNKNOWN_NOISE)
        able = [record for number, record in self.records.items() if eligible(self.steps[number])]
        return any(floor.error_of(one) <= floor.largest_error for one in able)

    @cached_property
    def comparison(self) -> Comparison | None:
        """What the found diagram has in common with the given truth."""
        if self.truth is None or self.answer is None:
            return None
        try:
            return compare(parse_program(self.answer.program), self.truth, self.kinds)
        except IbridError:
            return None


def read_run(
    store: Store, sweep: Sweep | None = None, kinds: Sequence[ModuleKind] | None = None
) -> RunData:
    """Read what a page needs; the store is not needed afterwards.

    sweep : in place of the data in the store. kinds : the vocabulary, where it is not a shipped
    one.
    """
    meta = dict(store.meta)
    settings = settings_of(meta.get("settings", ""))
    own = VOCABULARY if kinds is None else tuple(kinds)
    known = NAMED_VOCABULARIES.get(str(settings.get("vocabulary")), own)
    steps = {
        step.number: replace(step, reply="") for step in store.steps()
    }  # replies can be long, and are not shown
    notes: list[str] = []
    events, remark = measured(meta["events"], read_events) if meta.get("events") else (None, "")
    if sweep is None and (events is None or meta.get("data")):
        sweep, remark = measured(meta.get("data", ""), read_sweep)
    notes += [remark] if remark else []
    plain, chosen = plain_selection(steps.values()), None
    try:
        chosen = read_selection(inside(store.path.parent, SELECTION))
    except IbridError as problem:
        notes.append(str(problem))
    named = [
        None if chosen is None else chosen.answer,
        whole_number(meta.get("best", "")),
        plain.answer,
    ]
    answer = _first_fitted(steps, named)
    points = trajectory(steps.values())
    records = _records(store, steps, _worth_reading(points, steps, answer), known, notes)
    found = None if answer is None else records.get(answer.number)
    truth, truth_record, remark = given_truth(meta.get("truth", ""), sweep, found)
    notes += [remark] if remark else []
    return RunData(
        meta=meta,
        settings=settings,
        kinds=known,
        steps=steps,
        records=records,
        points=points,
        milestones=milestones(points, steps, records.get),
        sweep=sweep,
        events=events,
        selection=chosen or plain,
        answer=answer,
        truth=truth,
        truth_record=truth_record,
        retried=store.retried(),
        archive=mapping_in(meta.get("archive", "")),
        notes=tuple(notes),
        calls=tuple(store.calls()),
        final=_final_record(store.path.parent, answer, known),
    )


def _final_record(
    folder: Path, answer: Step | None, kinds: tuple[ModuleKind, ...]
) -> Record | None:
    """What the run has written as its best, where that is the answer's program."""
    if answer is None:
        return None
    try:
        record = read_record(inside(folder, BEST_RECORD), kinds)
        same = record.program == program_text(parse_program(answer.program))
    except IbridError:
        return None
    return record if same else None


def _worth_reading(
    points: Sequence[Point], steps: Mapping[int, Step], answer: Step | None
) -> set[int]:
    """Numbers of the steps whose records the page shows."""
    better = [steps[one.step] for one in points if one.better]
    way = [] if answer is None else line(steps, answer.number)
    return (
        {one.number for one in (*better, *way)}
        | {one.edited for one in better if one.edited is not None}
        | {0}
    )


def _records(
    store: Store,
    steps: Mapping[int, Step],
    numbers: set[int],
    kinds: tuple[ModuleKind, ...],
    notes: list[str],
) -> dict[int, Record]:
    """Records of those steps that were fitted; a damaged one becomes a note."""
    records: dict[int, Record] = {}
    for number in sorted(numbers):
        if number in steps and steps[number].nrmse is not None:
            try:
                records[number] = store.record(number, kinds)
            except IbridError as problem:
                notes.append(str(problem))
    return records


def settings_of(text: str) -> dict[str, Any]:
    """The run's settings as one flat table; empty where they cannot be read."""
    try:
        return _flat(toml_in(text))
    except ValueError:
        return {}


def _first_fitted(steps: Mapping[int, Step], numbers: Sequence[int | None]) -> Step | None:
    """The answer: the step of the selection, else the one the run calls its best, else what the
    steps say.
    """
    for number in numbers:
        step = None if number is None else steps.get(number)
        if step is not None and step.nrmse is not None and math.isfinite(step.nrmse):
            return step
    return None


def whole_number(text: str) -> int | None:
    """The number that a text of at most 18 digits is; None for other texts."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) < 19 else None


def measured(text: str, read: Callable[[Path], Data]) -> tuple[Data | None, str]:
    """The data that the run was started with, and a sentence when they cannot be read."""
    if not text:
        return (
            None,
            "The run holds no data, so there are no measured dots; give the sweep to show them.",
        )
    with tempfile.TemporaryDirectory(prefix="ibrid-") as folder:
        file = Path(folder) / "data.csv"
        file.write_text(text, encoding="utf-8")
        try:
            return read(file), ""
        except IbridError as problem:
            return (
                None,
                f"The data in the run cannot be read, so there are no measured dots: {problem}",
            )


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in table.items():
        found |= _flat(value) if isinstance(value, Mapping) else {name: value}
    return found


#: Settings of the found record that the truth is fitted with as well; the effort is that of `ibrid
#: evaluate`.
SAME = ("parameters", "equilibrium", "objective", "seed")


def given_truth(
    program: str, sweep: Sweep | None, best: Record | None
) -> tuple[Diagram | None, Record | None, str]:
    """Diagram and record of the truth, and a sentence when one of them cannot be had; nothing at
    all for no program.
    """
    if not program.strip():
        return None, None, ""
    try:
        diagram = parse_program(program, "the given truth")
    except IbridError as problem:
        return None, None, str(problem)
    if sweep is None or best is None:
        return diagram, None, ""
    options = {name: best.settings[name] for name in SAME if name in best.settings}
    fitted = best.settings.get("fitted_points", sweep.names)
    held = [name for name in sweep.names if name not in fitted]
    try:
        record = evaluate(diagram, sweep, vocabulary=best.vocabulary, holdout_op=held, **options)
    except IbridError as problem:
        return diagram, None, f"The given truth is not fitted: {problem}"
    if record.nrmse is None:
        return (
            diagram,
            None,
            f"The given truth has no fit ({record.outcome}): {'; '.join(record.reasons)}",
        )
    return diagram, record, ""
