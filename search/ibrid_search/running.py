"""ibrid.search(sweep, folder): a whole search, from the data to the chosen answer and its files;
resumable at any moment.
"""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import log
from pathlib import Path
from typing import Any, Unpack

from ibrid.border import methods_take_kinds, takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.adequacy import EQUALLY_GOOD
from ibrid.frozen import Frozen
from ibrid.interrupts import hearing_interrupts
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.formats.csv_file import sweep_csv
from ibrid.measurement.formats.event_csv import event_csv
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.vocabulary import Vocabulary
from ibrid.own_files import writing_as
from ibrid.parts.editing.device import device_parts
from ibrid.showing import brief, made_above, shown
from ibrid.structure.compiling.check import require_legal
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook_text
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.study import Study, StudyOptions
from ibrid.telling import telling
from ibrid.writing import inside, write_json, write_whole
from ibrid_search.evaluation.assess import QUICK, Assessor
from ibrid_search.evaluation.job import Evaluator
from ibrid_search.evaluation.local import LocalEvaluator
from ibrid_search.evaluation.processes import ProcessEvaluator
from ibrid_search.evaluation.ray_session import require_cluster
from ibrid_search.policy_package import policy_part
from ibrid_search.proposal import Proposer
from ibrid_search.proposers.choose import Proposers
from ibrid_search.recursion.keyboard import keyboard
from ibrid_search.recursion.loop import STOPPED, Loop
from ibrid_search.recursion.panel import Panel
from ibrid_search.recursion.progress import Progress
from ibrid_search.recursion.watcher import Watcher
from ibrid_search.report.page import write_run_page
from ibrid_search.run.run_folder import (
    ARCHIVE,
    PAGE,
    SELECTION,
    TRAJECTORY,
    digest,
    open_run,
    require_new_run,
    require_run,
    write_best,
)
from ibrid_search.run.store import Store
from ibrid_search.run.tally import counts
from ibrid_search.run.trajectory import eligible, trajectory, trajectory_csv
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.delay_form_intervals import widen_over_delay_forms
from ibrid_search.screening.edit_rankings import rankings_for
from ibrid_search.screening.plausibility import find_impossible_values
from ibrid_search.selection.rivals import VISIBLE, judged_by_events, rivals_beside, rivals_of
from ibrid_search.selection.selecting import residual_modules, select
from ibrid_search.settings import Goal, SearchSettings, Workers

#: What is wrong with the labels of the data.
Labels = tuple[Mapping[str, Any], ...]
#: A search that learns goes on for so many batches without a new structure, since a policy may have
#: to learn to make any.
PATIENT = 4
#: Candidates within the evidence that are fitted with full effort before the answer is chosen.
FINALISTS = 4
#: Best candidates by the sweep that records of events judge, beside the answer and its rivals.
JUDGED = 6
#: Proposers that see sweeps alone.
UNABLE = ("policy", "llm", "agent")
#: Why a structure is the answer where records of events judge.
WHY_EVENTS = (
    "of the structures that the sweep does not tell apart it explains sweep and records of events "
    "best"
)
#: Starts that are asked for wrong labels.
DOUBTING = 2


@methods_take_kinds
@dataclass(frozen=True)
class Run(Frozen):
    """What a search found. `best` : record of the answer, None when no candidate was valid.
    `ending` : why it ended.

    `trajectory` : (evaluation, nrmse, best so far). `selection` : the content of selection.json.
    `seconds` : of this sitting. `spent` : tokens, cost and seconds of language models in all
    sittings. `finished` : False when it was stopped and can be resumed.
    """

    folder: Path
    best: Record | None
    ending: str
    evaluations: int
    seconds: float
    trajectory: tuple[tuple[int, float | None, float | None], ...]
    statuses: Mapping[str, int]
    selection: Mapping[str, Any]
    spent: Mapping[str, float]
    finished: bool

    @property
    def answer_program(self) -> str:
        """Program text of the answer; "" without one."""
        return "" if self.best is None else self.best.program

    def __repr__(self) -> str:
        answer = "no valid candidate" if self.best is None else repr(self.best)
        return brief(f"<Run: {self.folder}, {self.evaluations} evaluations, {answer}", ">")

    def plot(self) -> Any:
        """A matplotlib figure: the NRMSE of every candidate, and the best so far."""
        return shown(self.trajectory, "plotting", "trajectory_plot")

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row for each evaluation: its NRMSE and the best so far."""
        names = ("evaluation", "nrmse", "best_so_far")
        rows = [dict(zip(names, step, strict=True)) for step in self.trajectory]
        return made_above(rows, "ibrid.measurement.dataframe", "table_frame")

    def save(self, path: str | Path) -> None:
        """Write the record of the answer; the run itself is kept in `folder`."""
        if self.best is None:
            raise IbridError("the search has no valid candidate, so there is no record to write")
        self.best.write(path)

    def _repr_html_(self) -> str:
        """How it went and what was found, for notebooks."""
        from ibrid.report.pages.notebook import (
            search_html,
        )  # figures are slow to import, and rarely asked for

        return search_html(self.folder, self.best, self.ending, self.evaluations, self.trajectory)


@takes_kinds
@hearing_interrupts()
@writing_as("search")
def search(
    sweep: Sweep | Events | Study,
    folder: str | Path,
    *,
    start: Diagram | str | None = None,
    proposer: str | Proposer | Sequence[tuple[Proposer, float]] | Proposers = "diagnosis",
    budget: int | Goal = 500,
    workers: int | Workers = 1,
    truth: Diagram | None = None,
    events: Events | None = None,
    resume: bool = False,
    settings: SearchSettings | None = None,
    progress: Progress | str = "interactive",
    **options: Unpack[StudyOptions],
) -> Run:
    """Search for the block diagram of a measured inverter.

    Parameters
    ----------
    sweep : measured operating points, records of events where nothing was swept, or a study of
    either. folder : where the run
        lives; refused when it holds one already, and with `resume` when it holds none.
    start : diagram or program text to begin from, and nowhere else; when not given, the shipped
    diagrams that a first look at
        the data finds best.
    proposer : "diagnosis", "rules", "random", "policy", "llm", "agent", a mix such as
    "rules:0.7,random:0.3", or proposers of
        one's own; `ibrid_search.Proposers` also says which models, what they may spend, which
        weights, and whether they learn.
    budget : evaluations at most, the start included; `ibrid_search.Goal` also says which error is
    enough, what a candidate
        must be, and how the answer is chosen.
    workers : evaluate so many candidates at once; `ibrid_search.Workers` also names a Ray cluster.
    truth : shown beside the answer; the search itself never sees it. One that is given with
    `resume` takes the place of an
        earlier one, and nothing else changes.
    events : records in time: of the structures that the sweep does not tell apart the answer is the
    one that explains both best,
        fitted to both together.
    settings : every other number, `ibrid_search.SearchSettings`. progress : "interactive", "auto",
    "terminal", "plain",
        "notebook", "silent", or a Progress.
    parameters, equilibrium, vocabulary, holdout_op, seed, port, labels : as of `ibrid.study.Study`;
    a label that the starts
        find wrong is put right before the search begins, and told in the answer's `labels`. The
        same seed gives the same archive, whatever the number of workers.

    Returns the Run; the folder holds run.toml, archive.sqlite, best.py, best.json, trajectory.csv,
    selection.json and report.html. Raises IbridError for wrong options, a folder that cannot be
    used, or a start without a fit.
    """
    began = time.monotonic()
    if not str(folder).strip():
        raise IbridError(
            "a run needs a folder for its files, found an empty name; write . for the current one"
        )
    folder = Path(folder)
    (require_run if resume else require_new_run)(folder)
    goal = budget if isinstance(budget, Goal) else Goal(budget)
    workers = workers if isinstance(workers, Workers) else Workers(workers)
    require_cluster(workers.ray)
    proposers = proposer if isinstance(proposer, Proposers) else Proposers(proposer)
    settings = settings or SearchSettings()
    study = Study.of(sweep, **options)
    weighted = proposers.weighted()
    if goal.choose == "op" and not study.held:
        raise IbridError(
            "choosing by held-out operating points needs some; name them with --holdout-op"
        )
    if events is not None and (study.parameters, study.equilibrium) != ("shared", "exact"):
        raise IbridError(
            "events are fitted with shared parameters and the exact equilibrium; leave the options "
            "out"
        )
    if study.events is not None:
        if events is not None:
            raise IbridError(
                "records of events are given twice; give a sweep and these as events, or these "
                "alone"
            )
        _require_able(weighted, goal)
    if not isinstance(start, Diagram | str | None):
        raise IbridError(
            f"start must be a diagram or program text, found {type(start).__name__}; give one, or "
            "none"
        )
    study = replace(study, devices=max(settings.devices, _devices(start, study.kinds)))
    goal.requirements.require_within(study.sweep)
    labels: Labels = ()
    if doubted := study.labels != "exact":
        study, labels = _put_right(start, study, settings)
    if start is not None:
        first, others = _text_of(start), ()
    else:
        known = _kept_starts(folder) if resume else None
        first, others = known or _starts(
            study, settings, progress if isinstance(progress, str) else "silent"
        )
    require_legal(parse_program(first, "the start"), study.kinds, equilibrium=study.equilibrium)
    asked = (
        {"prompt": proposers.prompt, "server": dict(proposers.server)} if proposers.models else {}
    )
    learnt: dict[str, Any] = {**proposers.weights(), **asked}
    if (lesson := proposers.learning()) is not None:
        weighted = policy_part("learning.choose").learning(
            weighted,
            lesson,
            seed=study.seed,
            window=settings.window,
            study=study.blind,
            start=first,
            folder=folder,
        )
        settings = replace(settings, patience=max(settings.patience, PATIENT * lesson.steps))
        learnt["learning"] = vars(lesson)
    panel = Panel(weighted, others)
    settings = replace(settings, history=panel.history(settings.history))
    if panel.undisturbed:
        settings = replace(settings, pruning=0.0)
    recorded, data = (
        events or study.events,
        "" if study.events is not None else sweep_csv(study.sweep),
    )
    shipped = json.dumps([[program_text(edit.diagram), edit.description] for edit in others])
    texts = {
        "data": data,
        "start": first,
        "starts": shipped,
        "truth": "" if truth is None else program_text(truth),
    }
    texts |= {} if recorded is None else {"events": event_csv(recorded)}
    stated = {
        "seed": study.seed,
        "budget": goal.budget,
        "target": goal.target,
        "proposer": panel.names,
        "models": list(proposers.models),
        "prices": [list(pair) for pair in proposers.prices],
        "parameters": study.parameters,
        "equilibrium": study.equilibrium,
        "vocabulary": study.vocabulary_name,
        **({"port": study.port.to_json()} if study.port else {}),
        **({"labels": [one["id"] for one in labels]} if doubted else {}),
        "holdout_op": list(study.held),
        "require": goal.require,
        "choose": goal.choose,
        "workers": workers.number,
        "ray": workers.ray or "",
        "data": study.sweep.source,
        "data_sha256": digest(texts["data"]),
        **(
            {}
            if recorded is None
            else {"events": recorded.source, "events_sha256": digest(texts["events"])}
        ),
        "start_sha256": digest(first),
        "settings": vars(settings),
        **learnt,
    }
    with open_run(folder, stated, texts, resume) as store:
        if truth is not None:
            store.set_meta("truth", texts["truth"])
        store.set_meta("ending", "")
        shown = Progress(progress) if isinstance(progress, str) else progress
        assessor = Assessor.of(study, settings.effort)
        watcher = Watcher(store, folder, shown, goal.budget)
        panel.tell(shown.aside)
        with _evaluator(assessor, workers, settings) as evaluator, shown:
            loop = Loop(study.blind, store, evaluator, panel, settings, goal, watch=watcher)
            panel.begin(store, folder)
            for terms in panel.terms:
                shown.say(terms)
            with keyboard(loop, shown):
                ending = loop.run(first)
        with keyboard(loop, shown):  # a second Ctrl-C may come only now
            answer, selection = _concluded(loop, assessor, folder, ending, labels, events)
            write_run_page(store, inside(folder, PAGE), vocabulary=study.kinds)
        points = trajectory(loop.steps)
        return Run(
            folder=folder,
            best=answer,
            ending=ending,
            evaluations=len(points),
            seconds=time.monotonic() - began,
            trajectory=tuple((one.evaluation, one.nrmse, one.best) for one in points),
            statuses={str(status): number for status, number in counts(loop.steps).items()},
            selection=selection,
            spent=dict(watcher.spending.spent),
            finished=ending != STOPPED,
        )


def _require_able(weighted: Sequence[tuple[Proposer, float]], goal: Goal) -> None:
    """IbridError for what a search in records alone cannot do."""
    unable = [proposer.name for proposer, _ in weighted if proposer.name in UNABLE]
    if unable:
        raise IbridError(
            f"{unable[0]} needs a sweep; records alone are searched by diagnosis, rules and random"
        )
    if goal.choose == "frequencies":
        raise IbridError(
            "records have no frequencies to hold out; choose by operating points, --choose op "
            "--holdout-op RECORD"
        )


def _devices(start: Diagram | str | None, kinds: Vocabulary) -> int:
    """How many devices a given start has; 1 where none is given, and of one that is not legal."""
    try:
        diagram = parse_program(start, "the start") if isinstance(start, str) else start
        return 1 if diagram is None else max(len(device_parts(diagram, kinds)), 1)
    except IbridError:
        return 1


def _text_of(start: Diagram | str) -> str:
    return program_text(start) if isinstance(start, Diagram) else start


def _starts(
    study: Study, settings: SearchSettings, progress: str = "silent"
) -> tuple[str, tuple[CandidateEdit, ...]]:
    """Text of the program to begin from where no start is given, and further diagrams."""
    with telling("silent" if study.events is None else progress) as tell:
        looks = rankings_for(study.blind).screener.screen_library(settings.devices, tell)[
            : settings.starts
        ]
    if not looks and settings.devices > 1:
        raise IbridError(
            "no shipped diagram of two devices has a response here; search with one, or give a "
            "start"
        )
    if not looks:
        return textbook_text("naive"), ()
    first, *others = (look.edit for look in looks)
    return program_text(first.diagram), tuple(others)


def _kept_starts(folder: Path) -> tuple[str, tuple[CandidateEdit, ...]] | None:
    """The start and the further diagrams of a run, which need not be looked for again."""
    archive = inside(folder, ARCHIVE)
    if not archive.exists() or archive.stat().st_size == 0:
        return None
    with Store.open(archive, read_only=True) as store:
        first, kept = store.meta.get("start", ""), store.meta.get("starts", "[]")
    try:
        others = tuple(
            CandidateEdit(parse_program(text), words, "", {}) for text, words in json.loads(kept)
        )
    except (ValueError, TypeError, RecursionError):  # damaged: they are looked for again
        return None
    return (first, others) if others else None


def _put_right(
    start: Diagram | str | None, study: Study, settings: SearchSettings
) -> tuple[Study, Labels]:
    """The study with the label put right that the best of the starts finds wrong, and what it says
    of it.
    """
    first, others = (
        (_text_of(start), ())
        if start is not None
        else _starts(replace(study, labels="exact"), settings)
    )
    diagrams = [parse_program(first, "the start"), *(one.diagram for one in others)][:DOUBTING]
    records = [evaluate(one, study.blind, settings=QUICK) for one in diagrams]
    fitted = [one for one in records if one.nrmse is not None]
    labels = min(fitted, key=lambda one: float(one.nrmse or 0.0)).labels if fitted else ()
    right = Convention.told(labels, study.sweep).undone(study.sweep) if labels else study.sweep
    return replace(study, sweep=right, labels="exact"), labels


def _evaluator(assessor: Assessor, workers: Workers, settings: SearchSettings) -> Evaluator:
    if workers == Workers():
        return LocalEvaluator(assessor)
    limits = {"processor_limit": settings.processor_limit, "lost": settings.lost}
    if workers.ray is None:
        return ProcessEvaluator(assessor, workers.number, **limits)
    from ibrid_search.evaluation.ray_actors import (
        RayEvaluator,
    )  # Ray is an extra, and slow to import

    return RayEvaluator(assessor, workers.number, address=workers.ray, **limits)


def _concluded(
    loop: Loop, assessor: Assessor, folder: Path, ending: str, labels: Labels, events: Events | None
) -> tuple[Record | None, Mapping[str, Any]]:
    """Fit the answer with full effort and write the files that sum the run up."""
    worth, store = loop.appraisal, loop.store
    write_whole(inside(folder, TRAJECTORY), trajectory_csv(trajectory(loop.steps)))
    store.set_meta("ending", ending)
    store.set_meta("archive", json.dumps(asdict(loop.archive.statistics())))
    if loop.best is None:
        return None, {}
    if ending == STOPPED:
        return worth.record(loop.best.number), {}
    spent = _fit_finalists(loop, assessor)
    selection = select(
        loop.steps, loop.best, worth.record, assessor, assessor.floor, worth.error, loop.goal.choose
    )
    seconds = spent + selection.pop("seconds")  # the file is the same for the same seed
    answer = loop.steps[selection["answer"]]
    rivals = (
        rivals_of(answer, loop.steps, worth.record, assessor.floor)
        if worth.at_floor(answer)
        else ()
    )
    noise = (
        assessor.floor.level if assessor.floor.known and assessor.study.events is None else VISIBLE
    )
    seconds += _fit_longer(loop, assessor, answer.number)
    record = worth.record(answer.number)
    ranked = (
        sorted(filter(eligible, loop.steps), key=worth.rank)[:JUDGED] if events is not None else []
    )
    numbers = dict.fromkeys(
        (answer.number, *(rival.step for rival in rivals), *(step.number for step in ranked))
    )
    if events is not None and (
        judged := judged_by_events(
            numbers, worth.record, partial(_allowed, loop), events, assessor.study
        )
    ):
        record, rivals = judged[0].record, rivals_beside(judged, loop.steps)
        seconds += sum(one.record.seconds for one in judged)
        selection |= {
            "answer": judged[0].step,
            "why": WHY_EVENTS,
            "residual_modules": residual_modules(record),
        }
        selection["events"] = [one.against(judged[0]) for one in judged]
    elif events is not None:
        selection["why"] += (
            "; no candidate has a rest in every record of the events and is stable as it is fitted "
            "to them"
        )
    selection["rivals"] = [vars(rival) | {"words": rival.words(noise)} for rival in rivals]
    write_json(inside(folder, SELECTION), selection)
    store.set_meta("refits", str(seconds))
    store.set_meta("best", str(selection["answer"]))
    record = widen_over_delay_forms(replace(record, labels=labels), assessor.study, assessor.floor)
    write_best(folder, record)
    return record, selection


def _fit_finalists(loop: Loop, assessor: Assessor) -> float:
    """Fit with full effort what the evidence leaves beside the best, and choose the best again;
    returns the seconds.

    Where the noise is known a fit that stopped early may lose to a wrong structure; where it is
    not, fits are exact or far apart.
    """
    worth, criterion = loop.appraisal, loop.appraisal.criterion
    if not criterion.floor.known or loop.best is None or not worth.at_floor(loop.best):
        return 0.0
    ranked = sorted(filter(eligible, loop.steps), key=worth.rank)
    most = worth.rank(ranked[0])[0] + log(EQUALLY_GOOD.odds) / criterion.floor.number_count
    close = [step for step in ranked if worth.rank(step)[0] <= most][:FINALISTS]
    seconds = (
        sum(_fit_longer(loop, assessor, step.number) for step in close) if len(close) > 1 else 0.0
    )
    loop.best = min(ranked, key=worth.rank)
    return seconds


def _fit_longer(loop: Loop, assessor: Assessor, number: int) -> float:
    """Fit a step once with full effort; what is better and as required takes the place of its
    record. Returns the seconds.
    """
    if number in loop.appraisal.longer:
        return 0.0
    before = loop.appraisal.record(number)
    again = assessor.record_of(before.program, assessor.whole, before.parameters)
    better = _allowed(loop, again) and assessor.floor.error_of(again) <= assessor.floor.error_of(
        before
    )
    loop.appraisal.fitted_longer(number, again if better else before)
    return again.seconds


def _allowed(loop: Loop, record: Record) -> bool:
    """Whether a fit is stable at every operating point, of possible values, and as the run
    requires.
    """
    fitted = record.outcome == Outcome.OK and all(record.stable.values())
    return (
        fitted and not find_impossible_values(record) and not loop.goal.requirements.unmet(record)
    )
