"""Everything that the page about a run needs, read once: steps, records, data, the selection and the given truth."""

import math
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.read import read_sweep
from ibrid.measurement.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import NAMED_VOCABULARIES, VOCABULARY
from ibrid.structure.compare import Comparison, compare
from ibrid.structure.diagram import Diagram
from ibrid.structure.program import parse_program
from search.report.selection import FILE, Selection, plain_selection, read_selection
from search.report.truth import given_truth
from search.step import Step
from search.trajectory import Milestone, Point, milestones, trajectory


class Stored(Protocol):
    """What is asked of a store; `search.store.Store` has it."""

    @property
    def path(self) -> Path: ...
    @property
    def meta(self) -> Mapping[str, str]: ...
    def steps(self) -> Iterator[Step]: ...
    def record(self, number: int, vocabulary: Sequence[ModuleKind], /) -> Record: ...


@dataclass(frozen=True)
class RunData:
    """A run as it stands.

    `kinds` : its vocabulary. `answer` : the step that is shown as found, None before the first valid one. `notes` : what
    could not be had, in sentences. `truth_record` : the given truth, fitted to the same data with the same options.
    """

    meta: Mapping[str, str]
    settings: Mapping[str, Any]
    kinds: tuple[ModuleKind, ...]
    steps: Mapping[int, Step]
    records: "Records"
    sweep: Sweep | None
    selection: Selection
    answer: Step | None
    truth: Diagram | None
    truth_record: Record | None
    notes: tuple[str, ...]

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """Best so far over the evaluations."""
        return trajectory(self.steps.values())

    @cached_property
    def milestones(self) -> tuple[Milestone, ...]:
        """The accepted improvements."""
        return milestones(self.points, self.steps, self.records.of)

    @property
    def start(self) -> Step | None:
        return self.steps.get(0)

    @cached_property
    def comparison(self) -> Comparison | None:
        """What the found diagram has in common with the given truth."""
        if self.truth is None or self.answer is None:
            return None
        try:
            return compare(parse_program(self.answer.program), self.truth, self.kinds)
        except IbridError:
            return None


class Records:
    """Records of a store, each read once."""

    def __init__(self, store: Stored, kinds: tuple[ModuleKind, ...]) -> None:
        self._store, self._kinds = store, kinds
        self._found: dict[int, Record | None] = {}

    def of(self, number: int) -> Record | None:
        """The record of a step, None where there is none."""
        if number not in self._found:
            try:
                self._found[number] = self._store.record(number, self._kinds)
            except IbridError:
                self._found[number] = None
        return self._found[number]


def read_run(store: Stored, sweep: Sweep | None = None, kinds: Sequence[ModuleKind] | None = None) -> RunData:
    """Read what a page needs. `sweep` : in place of the data in the store. `kinds` : the vocabulary, where it is not a
    shipped one."""
    meta = dict(store.meta)
    settings = _settings(meta.get("settings", ""))
    known = NAMED_VOCABULARIES.get(str(settings.get("vocabulary")), VOCABULARY)
    chosen = known if kinds is None else tuple(kinds)
    steps = {step.number: replace(step, reply="") for step in store.steps()}  # replies can be long, and are not shown
    notes: list[str] = []
    if sweep is None:
        sweep, remark = _measured(meta.get("data", ""))
        notes += [remark] if remark else []
    selection = plain_selection(steps.values())
    try:
        selection = read_selection(store.path.parent / FILE) or selection
    except IbridError as problem:
        notes.append(str(problem))
    records = Records(store, chosen)
    answer = _answer(meta, steps, selection)
    found = None if answer is None else records.of(answer.number)
    truth, truth_record, remark = given_truth(meta.get("truth", ""), sweep, found)
    notes += [remark] if remark else []
    return RunData(meta, settings, chosen, steps, records, sweep, selection, answer, truth, truth_record, tuple(notes))


def _settings(text: str) -> dict[str, Any]:
    """The run's settings as one flat table; empty where they cannot be read."""
    try:
        return _flat(tomllib.loads(text))
    except tomllib.TOMLDecodeError:
        return {}


def _answer(meta: Mapping[str, str], steps: Mapping[int, Step], selection: Selection) -> Step | None:
    """The step of the selection; else the one the run calls its best; else what the steps say."""
    plain = plain_selection(steps.values()).answer
    stated = meta.get("best", "")
    named = int(stated) if stated.isascii() and stated.isdecimal() else None
    for number in (selection.answer if selection.why else None, named, plain):
        step = None if number is None else steps.get(number)
        if step is not None and step.nrmse is not None and math.isfinite(step.nrmse):
            return step
    return None


def _measured(text: str) -> tuple[Sweep | None, str]:
    """The data that the run was started with, and a sentence when they cannot be read."""
    if not text:
        return None, "The run holds no data, so there are no measured dots; give the sweep to show them."
    with tempfile.TemporaryDirectory(prefix="ibrid-") as folder:
        file = Path(folder) / "data.csv"
        file.write_text(text, encoding="utf-8")
        try:
            return read_sweep(file), ""
        except IbridError as problem:
            return None, f"The data in the run cannot be read, so there are no measured dots: {problem}"


def _flat(table: Mapping[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in table.items():
        found |= _flat(value) if isinstance(value, Mapping) else {name: value}
    return found
