"""A first answer about a sweep or records of events: what is odd, which shipped diagram explains it
and how well, what next.
"""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, log
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.grade import LEAST_UNKNOWN, Grade
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FIT_EFFORTS, FitSettings, require_one_of
from ibrid.frozen import Frozen
from ibrid.gap.recordings.event_question import asked
from ibrid.gap.recordings.joint_fit import evaluate_records, weighed_by_events
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.conventions.positive_sequence import NOTE
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.quality.event_inspection import EventsInspection, inspect_events
from ibrid.measurement.quality.inspect import Inspection, inspect
from ibrid.measurement.quality.inspection_table import format_events_inspection, format_inspection
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.own_files import writing_as
from ibrid.report.pages.page import record_facts
from ibrid.report.pages.playback_page import facts_of_record
from ibrid.report.pages.template import page
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.network.outside import NOTHING, Outside
from ibrid.study import Study
from ibrid.telling import Tell
from ibrid.writing import inside, write_json, write_whole
from ibrid_search.archives.appraisal import sort_of_control
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.edit_screening import ScreeningFit
from ibrid_search.screening.plausibility import find_impossible_values
from ibrid_search.screening.selection_criterion import SelectionCriterion
from ibrid_search.screening.settings import SCREENING
from ibrid_search.starting.families import family_words, follows
from ibrid_search.starting.other_plls import looks_with_other_plls

PROGRAM, RECORD, JSON, PAGE = FILES = ("model.py", "model.json", "start.json", "report.html")
GRADES = tuple(map(str, Grade))
FITS = GRADES[:2]
_WORDS = {
    "explains": "explains these data: what is left is no larger than {noise}",
    "close": "is close: what is left is up to twice {noise}",
    "rough": "fits roughly, with an error of at most 10 %: something of the device is missing in "
    "it",
    "fails": "does not fit: the device is of another make, or the file's labels are wrong",
}
#: What is said of a diagram of another family with the same grade.
_AS_GOOD = {
    "explains": "explains them too: these data do not tell which of the two the device is",
    "close": "is as close: these data do not tell which of the two the device is",
    "rough": "fits roughly too, so that the family is open",
}
#: Of a fit whose diagram a look has chosen.
SHORT = FitSettings(restarts=1)


@dataclass(frozen=True)
class StartSettings:
    """How much work a first answer takes.

    `fitted` : diagrams that are fitted after the looks. `raced` : the same of records, whose race
    is short, while none fits.
    `mild` : of records that no diagram fits together, so many are explained alone, the mildest
    first, until one is. `plls` : grid-following diagrams that are looked at with other PLLs. `fit`
    : effort of each fit.
    """

    fitted: int = 3
    raced: int = 6
    mild: int = 2
    plls: int = 12
    fit: FitSettings = SHORT


#: The settings of each effort.
START_EFFORTS: Mapping[str, StartSettings] = MappingProxyType(
    {
        "low": StartSettings(fitted=2, raced=3, mild=1, plls=6, fit=FIT_EFFORTS["low"]),
        "normal": StartSettings(),
        "high": StartSettings(fitted=6, raced=12, mild=4, plls=24, fit=FIT_EFFORTS["normal"]),
    }
)


@dataclass(frozen=True, eq=False)
class Ranked(Frozen):
    """A shipped diagram.

    `nrmse` : of the fit where there is a `record`, else of a first look. `held_out` : operating
    point -> error there when it is kept out of the fit. `grade` : one of `GRADES`, "" where only
    looked at. `bic` : the Bayesian information criterion on sweep and records of events, where the
    record is fitted to both. `drawn` : the diagram itself where one of its blocks is another than
    in the one that ships.
    """

    diagram: str
    nrmse: float
    grade: str = ""
    held_out: dict[str, float] | None = None
    record: Record | None = None
    bic: float = inf
    drawn: Diagram | None = None

    @property
    def structure(self) -> Diagram:
        """The diagram itself."""
        return textbook(self.diagram) if self.drawn is None else self.drawn

    @property
    def by_record(self) -> dict[str, float]:
        """NRMSE of each record of events that it was fitted to."""
        return {} if self.record is None else dict(self.record.nrmse_by_record)


@dataclass(frozen=True, eq=False)
class Start:
    """The answer. `ranked` : the best first. `family` : what the best diagram's control is called.
    `next` : commands.
    `events` : records beside a sweep. `alone` : the only one of several records that was fitted, ""
    where all were.
    `effort` : one of `START_EFFORTS`. `rival` : a diagram of another family with the same grade,
    and the words of that.
    `devices` : behind the terminals at most, as asked.
    """

    data: Sweep | Events
    inspection: Inspection | EventsInspection
    ranked: tuple[Ranked, ...]
    family: str
    next: tuple[str, ...] = ()
    events: Events | None = None
    alone: str = ""
    effort: str = "normal"
    rival: str = ""
    devices: int = 1

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is odd about sweep and records."""
        return (
            *self.inspection.warnings,
            *(contradictions(self.events) if self.events is not None else ()),
        )

    @property
    def records(self) -> Events | None:
        """Of events, alone or beside a sweep."""
        return self.data if isinstance(self.data, Events) else self.events

    @property
    def work(self) -> dict[str, int]:
        """Diagrams that were fitted, and the evaluations of the model that their fits took."""
        records = [ranked.record for ranked in self.ranked if ranked.record is not None]
        evaluations = sum(int(record.starts.get("evaluations", 0)) for record in records)
        return {"fits": len(records), "evaluations": evaluations}

    @property
    def best(self) -> Ranked:
        return self.ranked[0]

    @property
    def sentence(self) -> str:
        """The answer in a line or two."""
        record = self.best.record
        known = (
            record is not None
            and record.misfit is not None
            and record.misfit["floor"]["from"] != "unknown"
        )
        noise = (
            "the noise" if known else f"{LEAST_UNKNOWN:g} of the data, whose noise nobody states"
        )
        words = _WORDS[self.best.grade].format(noise=noise)
        sure = f"The shipped diagram {self.best.diagram} ({self.family}) {words}."
        if self.rival:
            sure += f" {self.rival} {_AS_GOOD[self.best.grade]}."
        unswept, held = isinstance(self.data, Events), self.best.held_out or {}
        if self.alone:
            sure = (
                f"Of the mild record {self.alone} alone: t{sure[1:]} In the others a limit may "
                "act: ask ibrid gap."
            )
        elif unswept and self.best.grade not in FITS:
            sure += " A limit that acts in a record is asked for by ibrid gap."
        points = "; ".join(
            f"{error:.2g} {'in' if unswept else 'at'} {op}" for op, error in held.items()
        )
        sure += (
            f" Error {'in a record' if unswept else 'at a point'} that the fit never saw: {points}."
            if held
            else ""
        )
        by_record = {} if self.alone else self.best.by_record
        records = "; ".join(f"{error:.2g} in {name}" for name, error in by_record.items())
        if self.records is not None and not (records or self.alone):
            return sure + " No diagram that was fitted has a rest in every record of events."
        fitted = (
            "Error of the records"
            if unswept
            else "Error of the records of events, fitted with the sweep"
        )
        return sure + (f" {fitted}: {records}." if records else "")

    def to_json(self) -> dict[str, Any]:
        """The contract `ibrid.start/1`."""
        return {
            "schema": "ibrid.start/1",
            "sentence": self.sentence,
            "family": self.family,
            "data": self.inspection.to_json(),
            "ranked": [
                {
                    "diagram": ranked.diagram,
                    "nrmse": ranked.nrmse,
                    "grade": ranked.grade or None,
                    "held_out": ranked.held_out,
                    **({"nrmse_by_record": ranked.by_record} if ranked.by_record else {}),
                }
                for ranked in self.ranked
            ],
            "next": list(self.next),
            "effort": self.effort,
            "work": self.work,
        }


@hearing_interrupts()
def start(
    data: Sweep | Events,
    *,
    tell: Tell,
    seed: int = 0,
    port: Outside = NOTHING,
    events: Events | None = None,
    effort: str = "normal",
    devices: int = 1,
) -> Start:
    """Look at the data, at every shipped diagram of one device behind the port, and fit the best
    few; where none with a PLL explains a sweep, those with one again with other PLLs.

    data : a sweep, or records where nothing was swept. events : records beside a sweep, to which
    the few are then fitted, too, and ranked by the Bayesian information criterion. effort : one of
    `START_EFFORTS`. devices : behind the terminals, 1 or 2; with 2 a diagram of two in parallel is
    fitted to a sweep where none of one fits.

    Raises IbridError where no shipped diagram has a response at these operating points, and for
    another number of devices.
    """
    require_one_of("effort", effort, tuple(START_EFFORTS))
    if devices not in (1, 2):
        raise IbridError(f"devices behind the terminals must be 1 or 2, found {devices}")
    settings = START_EFFORTS[effort]
    inspection = inspect_events(data) if isinstance(data, Events) else inspect(data)
    study = Study.of(data, seed=seed, port=port)
    screener = rankings_for(study).screener
    looks = screener.screen_library(tell=lambda words, share: tell(words, 0.6 * share))
    if not looks:
        raise IbridError(
            "no shipped diagram has a response at these operating points; look at the data with "
            "ibrid inspect"
        )
    most = settings.fitted if study.events is None else settings.raced
    fitted = _few_fitted(looks, study, settings, most, tell)
    alone = ""
    looked = [Ranked(look.edit.source, look.error) for look in looks[len(fitted) :]]
    if fitted[0].grade not in FITS and study.events is not None:
        fitted, alone = _of_one_record(fitted, study, study.events, settings, tell)
    elif study.events is None and not _explained_by_a_pll(fitted[0], study):
        fitted = _with_other_plls(fitted, looks, study, settings, tell)
    if fitted[0].grade not in FITS and study.events is None and devices == 2:
        tell("no diagram of one device fits: two in parallel", 0.86)
        pairs = [_fitted(look, study, settings) for look in screener.screen_library(2)[:1]]
        fitted = [pair for pair in pairs if pair.grade in FITS] + fitted
    if events is not None:
        tell(f"fitting {len(fitted)} diagrams to the records too", 0.88)
        fitted = sorted(
            (_fitted_to_both(ranked, study, events) for ranked in fitted),
            key=lambda ranked: ranked.bic,
        )
    first = fitted[0]
    if not alone:
        tell(f"predicting what is held out with {first.diagram}", 0.92)
        first = replace(first, held_out=_held_out(first, study, settings))
    others = [ranked for ranked in fitted[1:] if ranked.grade != GRADES[-1]]
    failed = [ranked for ranked in fitted[1:] if ranked.grade == GRADES[-1]]
    others += sorted([*failed, *looked], key=lambda ranked: ranked.nrmse)
    tell("the page", 1.0)
    family = family_words(sort_of_control(first.structure, study.kinds))
    family = (
        "family and dq structure cannot be told from a positive sequence alone"
        if NOTE in data.notes
        else family
    )
    rival = _rival(first, others, study)
    told = {"effort": effort, "rival": rival, "devices": devices}
    return Start(data, inspection, (first, *others), family, events=events, alone=alone, **told)


def _rival(first: Ranked, others: Sequence[Ranked], study: Study) -> str:
    """A diagram of the best one's grade whose frame follows none of what that one's does, with its
    family.
    """
    if first.grade not in _AS_GOOD:
        return ""
    own = follows(first.structure, study.kinds)
    for other in others:
        if other.grade == first.grade and own.isdisjoint(follows(other.structure, study.kinds)):
            return (
                f"{other.diagram} ({family_words(sort_of_control(other.structure, study.kinds))})"
            )
    return ""


@writing_as("start")
def write_start(answer: Start, data: str, folder: Path, behind: Sequence[str] = ()) -> Start:
    """Write start.json, model.py, model.json and report.html; the answer with the commands that go
    on from there.

    data : the sweep or the records as the commands are to name it. behind : their words about a
    port and records beside it.
    """
    record = answer.best.record
    if record is not None:
        write_whole(inside(folder, PROGRAM), record.program)
        record.write(inside(folder, RECORD))
    answer = replace(answer, next=_next(answer, data, folder, behind))
    write_json(inside(folder, JSON), answer.to_json())
    write_whole(inside(folder, PAGE), start_html(answer))
    return answer


def start_html(answer: Start) -> str:
    """The page as text."""
    record = answer.best.record
    sweep = answer.data if isinstance(answer.data, Sweep) else None
    facts = record_facts(record, sweep, "bode") if record is not None else {}
    facts["events"] = facts_of_record(record, answer.records)
    look, swept = answer.inspection, sweep is not None
    first_look = (
        format_events_inspection(look)
        if isinstance(look, EventsInspection)
        else format_inspection(look)
    )
    return page(
        "start.html",
        {**facts, "answer": answer, "swept": swept, "first_look": first_look},
        "ibrid_search",
    )


def _few_fitted(
    looks: Sequence[ScreeningFit], study: Study, settings: StartSettings, most: int, tell: Tell
) -> list[Ranked]:
    """The first few, up to `most` while none of them fits; the best first."""
    fitted = list[Ranked]()
    for number, look in enumerate(looks[:most]):
        if number >= settings.fitted and any(ranked.grade in FITS for ranked in fitted):
            break
        tell(f"fitting {look.edit.source}", 0.6 + 0.3 * min(number / settings.fitted, 1.0))
        fitted.append(_fitted(look, study, settings))
    return _in_order(fitted, study)


def _in_order(fitted: Sequence[Ranked], study: Study) -> list[Ranked]:
    """What is possible first, by grade, then by error and price."""
    measure = rankings_for(study.blind).screener.criterion

    def rank(ranked: Ranked) -> tuple[bool, int, float]:
        impossible = ranked.record is not None and bool(find_impossible_values(ranked.record))
        return impossible, GRADES.index(ranked.grade), _worth(ranked, measure)

    return sorted(fitted, key=rank)


def _explained_by_a_pll(ranked: Ranked, study: Study) -> bool:
    """Whether a diagram fits whose frame follows the voltage alone: then it need not be asked where
    that rests in the frame.
    """
    return ranked.grade in FITS and follows(ranked.structure, study.kinds) == {"phase"}


def _with_other_plls(
    fitted: list[Ranked],
    looks: Sequence[ScreeningFit],
    study: Study,
    settings: StartSettings,
    tell: Tell,
) -> list[Ranked]:
    """With the best few diagrams whose PLL rests with voltage on its q axis, the best first: a
    frame beside the voltage couples its magnitude to the angle, which otherwise a droop of the
    power alone does.
    """
    tell("the grid-following diagrams with other PLLs", 0.85)
    turned = looks_with_other_plls(
        rankings_for(study).screener, looks[: settings.plls], settings.fitted
    )
    few = [_fitted(look, study, settings) for look in turned]
    return _in_order([*fitted, *few], study)


def _of_one_record(
    failed: list[Ranked], study: Study, events: Events, settings: StartSettings, tell: Tell
) -> tuple[list[Ranked], str]:
    """Where no diagram fits all records, the one that fits a mild record alone before them, with
    the name of that record.
    """
    for name in events.mildest_first[: min(settings.mild, len(events.records) - 1)]:
        tell(f"no diagram fits all records: {name} alone", 0.86)
        mild = Study.of(study, holdout_op=[one for one in events.names if one != name])
        looks = rankings_for(mild.blind).screener.screen_library()
        few = _few_fitted(
            looks, mild, settings, settings.fitted, lambda words, share: tell(words, 0.86)
        )
        best = next(iter(few), None)
        if best is not None and best.record is not None and best.grade in FITS:
            first = replace(best, held_out=dict(best.record.holdout))
            return [first, *(one for one in failed if one.diagram != first.diagram)], name
    return failed, ""


def _fitted(look: ScreeningFit, study: Study, settings: StartSettings) -> Ranked:
    warm = dict(zip(study.fitted.names, look.values, strict=True))
    record = _record(look.edit.diagram, study, warm, settings)
    if record.nrmse is None:
        return Ranked(look.edit.source, look.error, "fails")
    return Ranked(
        look.edit.source, record.nrmse, str(record.grade), None, record, drawn=look.edit.diagram
    )


def _record(
    diagram: Diagram, study: Study, warm: Mapping[str, Mapping[str, float]], settings: StartSettings
) -> Record:
    if study.events is not None:
        return evaluate_records(diagram, study, settings.fit, warm)
    return evaluate(diagram, study, settings=settings.fit, warm=warm)


def _fitted_to_both(ranked: Ranked, study: Study, events: Events) -> Ranked:
    """The diagram fitted to sweep and records; as it was, and behind all others, where it has no
    rest in one of them.
    """
    if ranked.record is None:
        return ranked
    try:
        record, bic = weighed_by_events(asked(ranked.record, study, None, events, {}))
    except IbridError:
        return ranked
    nrmse = ranked.nrmse if record.nrmse is None else record.nrmse
    return replace(ranked, nrmse=nrmse, grade=str(record.grade), record=record, bic=bic)


def _worth(ranked: Ranked, measure: SelectionCriterion) -> float:
    """The error and the price of the free numbers, as a search chooses: a part that noise feigns
    must not decide.
    """
    if ranked.record is None:
        return log(max(ranked.nrmse, SCREENING.exact_error))
    return measure.value(measure.floor.error_of(ranked.record), ranked.record.free_parameters)


def _held_out(best: Ranked, study: Study, settings: StartSettings) -> dict[str, float] | None:
    """Error at the last operating point, or in the last record, of the best diagram fitted again to
    the rest.
    """
    names = study.sweep.names
    if best.record is None or len(names) < 2:
        return None
    warm = best.record.parameters
    blind = {op: warm[op] for op in names[:-1] if op in warm}
    record = _record(best.structure, Study.of(study, holdout_op=names[-1]), blind, settings)
    return dict(record.holdout) or None


def _next(answer: Start, data: str, folder: Path, behind: Sequence[str]) -> tuple[str, ...]:
    """Three commands, what the grade asks for first; where no diagram of one device fits a sweep,
    also how two are asked for.
    """
    model, record = str(folder / "model.py"), str(folder / "model.json")
    two = ["--devices", "2"] if answer.family.startswith("two devices") else []
    search = ["ibrid", "search", data, *behind, *two, "--out", str(folder / "search")]
    unswept = isinstance(answer.data, Events)
    gap = [
        "ibrid",
        "gap",
        record if unswept else model,
        data,
        *behind,
        "--out",
        str(folder / "gap"),
    ]
    stability = [
        "ibrid",
        "stability",
        record,
        "--scr",
        "1.5:10",
        "--report",
        str(folder / "stability.html"),
    ]
    op = answer.data.names[0]
    export = [
        "ibrid",
        "export",
        record,
        "--op",
        op,
        "--format",
        "control-json",
        "--out",
        str(folder / "linear.json"),
    ]
    if answer.best.record is None:
        chosen: Sequence[list[str]] = (search, ["ibrid", "inspect", data], ["ibrid", "modules"])
    elif answer.best.grade in FITS and not answer.alone:
        chosen = (stability, export, search if two else gap)
    else:
        first = (
            (gap, search) if unswept else (search, gap)
        )  # in records a limit is likelier than another make
        chosen = (*first, stability)
    if answer.best.grade not in FITS and answer.devices == 1 and not unswept:
        again = ["ibrid", "start", data, *behind, "--devices", "2", "--out", f"{folder}_of_two"]
        chosen = (*chosen, again)
    return tuple(map(shlex.join, chosen))
