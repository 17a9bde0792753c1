"""A first answer about a sweep: what is odd about it, which shipped diagram explains it and how well, and what to do next."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.grade import LEAST_UNKNOWN, Grade
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.inspect import Inspection, inspect
from ibrid.measurement.inspection_table import format_inspection
from ibrid.measurement.sweep import Sweep
from ibrid.report.page import record_facts
from ibrid.report.template import page
from ibrid.structure.library import textbook
from ibrid.structure.outside import NOTHING, Outside
from ibrid.study import Study
from ibrid.telling import Tell
from ibrid.writing import write_whole
from ibrid_search.appraisal import sort_of_control
from ibrid_search.diagnosis import Looker, RankedEdit
from ibrid_search.merit import Floor, criterion
from ibrid_search.settings import SearchSettings

#: Diagrams that are fitted after the looks, seconds of each fit at most, and waves of starts.
FITTED, SECONDS, RESTARTS = 3, 12.0, 1
GRADES = tuple(map(str, Grade))
_WORDS = {
    "explains": "explains these data: what is left is no larger than {noise}",
    "close": "is close: what is left is up to twice {noise}",
    "rough": "fits roughly, with an error of at most 10 %: something of the device is missing in it",
    "fails": "does not fit: the device is of another make, or the file's labels are wrong",
}
#: What control of a sort is called.
_FAMILIES = {
    "phase": "grid-following, a PLL gives its angle",
    "power": "grid-forming, power sets its frequency",
    "oscillator": "grid-forming, an oscillator sets its frequency",
    "nothing": "without synchronisation",
}


@dataclass(frozen=True, eq=False)
class Ranked:
    """A shipped diagram. `nrmse` : of the fit where there is a `record`, else of a first look. `held_out` : operating point ->
    error there when it is kept out of the fit. `grade` : one of `GRADES`, "" where only looked at."""

    diagram: str
    nrmse: float
    grade: str = ""
    held_out: dict[str, float] | None = None
    record: Record | None = None


@dataclass(frozen=True, eq=False)
class Start:
    """The answer. `ranked` : the best first. `family` : what the best diagram's control is called.
    `floor` : of the noise. `next` : commands."""

    sweep: Sweep
    inspection: Inspection
    ranked: tuple[Ranked, ...]
    family: str
    floor: Floor
    next: tuple[str, ...] = ()

    @property
    def best(self) -> Ranked:
        return self.ranked[0]

    @property
    def sentence(self) -> str:
        """The answer in a line or two."""
        noise = "the noise" if self.floor.known else f"{LEAST_UNKNOWN:g} of the data, whose noise nobody states"
        words = _WORDS[self.best.grade].format(noise=noise)
        sure = f"The shipped diagram {self.best.diagram} ({self.family}) {words}."
        held = self.best.held_out or {}
        points = "; ".join(f"{error:.2g} at {op}" for op, error in held.items())
        return sure + (f" Error at a point that the fit never saw: {points}." if held else "")

    def to_json(self) -> dict[str, Any]:
        """The contract `ibrid.start/1`."""
        return {
            "schema": "ibrid.start/1",
            "sentence": self.sentence,
            "family": self.family,
            "data": self.inspection.to_json(),
            "ranked": [
                {"diagram": one.diagram, "nrmse": one.nrmse, "grade": one.grade or None, "held_out": one.held_out}
                for one in self.ranked
            ],
            "next": list(self.next),
        }


def start(sweep: Sweep, *, tell: Tell, seed: int = 0, port: Outside = NOTHING) -> Start:
    """Look at the data, at every shipped diagram of one device behind the port, and fit the best few.

    Raises IbridError where no shipped diagram has a response at these operating points.
    """
    inspection = inspect(sweep)
    study = Study(sweep, seed=seed, port=port)
    measure = criterion(study, SearchSettings())
    looks = Looker(study, measure).textbooks(tell=lambda words, share: tell(words, 0.6 * share))
    if not looks:
        raise IbridError(
            "no shipped diagram has a response at these operating points; look at the data with ibrid inspect"
        )
    fitted = []
    for number, look in enumerate(looks[:FITTED]):
        tell(f"fitting {look.edit.part}, {number + 1} of {min(FITTED, len(looks))}", 0.6 + 0.3 * number / FITTED)
        fitted.append(_fitted(look, study))
    fitted.sort(key=lambda one: (GRADES.index(one.grade), one.nrmse))
    tell(f"predicting a held-out point with {fitted[0].diagram}", 0.92)
    first = _held_out(fitted[0], study)
    rest = [Ranked(look.edit.part, look.error) for look in looks[FITTED:]]
    tell("the page", 1.0)
    family = _family(sort_of_control(textbook(first.diagram), study.kinds))
    return Start(sweep, inspection, (first, *fitted[1:], *rest), family, measure.floor)


def write_start(answer: Start, data: str, folder: Path, port: str | None = None) -> Start:
    """Write start.json, model.py, model.json and report.html; the answer with the commands that go on from there.

    data, port : the sweep and the file of its port as the commands are to name them.
    """
    record = answer.best.record
    if record is not None:
        write_whole(folder / "model.py", record.program)
        write_whole(folder / "model.json", json.dumps(record.to_json(), indent=1, allow_nan=False) + "\n")
    answer = replace(answer, next=_next(answer, data, folder, port))
    write_whole(folder / "start.json", json.dumps(answer.to_json(), indent=1, allow_nan=False) + "\n")
    write_whole(folder / "report.html", start_html(answer))
    return answer


def start_html(answer: Start) -> str:
    """The page as text."""
    record = answer.best.record
    facts = record_facts(record, answer.sweep, "bode") if record is not None else {}
    return page(
        "start.html",
        {**facts, "answer": answer, "first_look": format_inspection(answer.inspection)},
        "ibrid_search",
    )


def _family(sort: str) -> str:
    """A sort of control as an engineer says it."""
    follows, _, loop = sort.partition(", ")
    names = [_FAMILIES.get(word, word) for word in follows.split(" and ")]
    return " and ".join(names) + (f", with a {loop}" if loop else "")


def _fitted(look: RankedEdit, study: Study) -> Ranked:
    warm = dict(zip(study.fitted.names, look.values, strict=True))
    record = evaluate(look.edit.diagram, study, restarts=RESTARTS, settings=FitSettings(seconds=SECONDS), warm=warm)
    if record.nrmse is None:
        return Ranked(look.edit.part, look.error, "fails")
    return Ranked(look.edit.part, record.nrmse, str(record.grade), None, record)


def _held_out(best: Ranked, study: Study) -> Ranked:
    """The best diagram fitted again without the last operating point, and its error there."""
    names = study.sweep.names
    if best.record is None or len(names) < 2:
        return best
    settings = FitSettings(seconds=SECONDS)
    warm = best.record.parameters
    blind = {op: warm[op] for op in names[:-1] if op in warm}
    record = evaluate(
        textbook(best.diagram), Study.of(study, holdout_op=names[-1]), restarts=RESTARTS, settings=settings, warm=blind
    )
    return Ranked(best.diagram, best.nrmse, best.grade, dict(record.holdout) or None, best.record)


def _next(answer: Start, data: str, folder: Path, port: str | None) -> tuple[str, ...]:
    """Three commands: what the grade asks for first."""
    model, record = str(folder / "model.py"), str(folder / "model.json")
    behind = [] if port is None else ["--port", port]
    search = ["ibrid", "search", data, *behind, "--out", str(folder / "search")]
    gap = ["ibrid", "gap", model, data, *behind, "--out", str(folder / "gap")]
    stability = ["ibrid", "stability", record, "--scr", "1.5:10", "--report", str(folder / "stability.html")]
    op = answer.sweep.names[0]
    export = ["ibrid", "export", record, "--op", op, "--format", "control-json", "--out", str(folder / "linear.json")]
    if answer.best.record is None:
        chosen: Sequence[list[str]] = (search, ["ibrid", "inspect", data], ["ibrid", "modules"])
    elif answer.best.grade in GRADES[:2]:
        chosen = (stability, export, gap)
    else:
        chosen = (search, gap, stability)
    return tuple(map(shlex.join, chosen))
