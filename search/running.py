"""search.run(sweep, folder): a whole search, from the data to the chosen answer and its files; resumable at any moment."""

import hashlib
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.plan import make_plan
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.csv_file import sweep_csv
from ibrid.measurement.noise_estimate import with_sigma
from ibrid.measurement.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.structure.check import require_legal
from ibrid.structure.diagram import Diagram
from ibrid.structure.library import textbook_text
from ibrid.structure.program import parse_program, program_text
from ibrid.writing import write_whole
from search.evaluation.assess import Subject
from search.evaluation.job import Evaluator
from search.evaluation.local import LocalEvaluator
from search.loop import STOPPED, USABLE, Goal, Loop
from search.merit import criterion
from search.page import ARCHIVE, write_run_page
from search.page import FILE as PAGE
from search.progress import Progress, Snapshot, milestone_row
from search.proposal import Proposer, Task
from search.proposers.agent import Agent
from search.proposers.choose import choose_proposers
from search.proposers.language_model import LanguageModel
from search.proposers.spending import Limits
from search.report.selection import FILE as SELECTION
from search.requirements import parse_requirements
from search.run_file import read_run_toml, require_same, run_toml
from search.selecting import WAYS, select, selection_json
from search.settings import SearchSettings
from search.step import EVALUATED, Status, Step
from search.store import Store
from search.tally import Tally, counts
from search.trajectory import improves, milestone, trajectory, trajectory_csv

RUN_TOML, BEST_PROGRAM, BEST_RECORD, TRAJECTORY = "run.toml", "best.py", "best.json", "trajectory.csv"
#: What SQLite and the store keep beside the archive.
BESIDE_ARCHIVE = ("archive.lock", "archive.sqlite-wal", "archive.sqlite-shm")


@dataclass(frozen=True)
class Run:
    """What a search found. `best` : record of the answer, None when no candidate was valid. `ending` : why it ended.

    `trajectory` : (evaluation, nrmse, best so far). `selection` : the content of selection.json. `seconds` : of this
    sitting. `finished` : False when it was stopped and can be resumed.
    """

    folder: Path
    best: Record | None
    ending: str
    evaluations: int
    seconds: float
    trajectory: tuple[tuple[int, float | None, float | None], ...]
    statuses: Mapping[str, int]
    selection: Mapping[str, Any]
    finished: bool

    @property
    def answer_program(self) -> str:
        """Program text of the answer; "" without one."""
        return "" if self.best is None else self.best.program


def run(
    sweep: Sweep,
    folder: str | Path,
    *,
    start: Diagram | str | None = None,
    proposer: str | Proposer | Sequence[tuple[Proposer, float]] = "rules",
    models: Sequence[str] = (),
    limits: Limits | None = None,
    budget: int = 500,
    target: float | None = None,
    seed: int = 0,
    workers: int = 1,
    ray: str | None = None,
    parameters: str = "shared",
    equilibrium: str = "exact",
    vocabulary: str | Sequence[ModuleKind] = "extended",
    holdout_op: str | Sequence[str] = (),
    history: int = 0,
    require: str | None = None,
    choose: str = "error",
    truth: Diagram | None = None,
    resume: bool = False,
    settings: SearchSettings | None = None,
    progress: Progress | str = "silent",
) -> Run:
    """Search for the block diagram of a measured inverter.

    Parameters
    ----------
    sweep : measured operating points. folder : where the run lives; refused when it holds one already, unless `resume`.
    start : diagram or program text to begin from; the naive one when not given.
    proposer : "rules", "random", "llm", "agent", a mix such as "rules:0.7,random:0.3", or proposers of one's own.
    models : for "llm" and "agent": "NAME@URL*WEIGHT" or folders of local models. limits : what they
        may spend in the whole run, `search.proposers.spending.Limits`.
    budget : evaluations at most, the start included. target : NRMSE that ends the search; None: only the noise floor does.
    seed : of everything random; the same seed gives the same archive, whatever the number of `workers`.
    workers : 1 evaluates in this process, more on a local Ray. ray : address of a Ray cluster.
    parameters, equilibrium, vocabulary, holdout_op : as for `ibrid.evaluate`.
    history : best candidates and last failures that a proposer sees beside the parent; 0 is the paper's setting.
    require : "stable", "passive:LO-HI", joined by commas; what does not meet it is not admitted.
    choose : the answer by "error", held-out "frequencies", or held-out operating points ("op").
    truth : shown beside the answer; the search itself never sees it.
    settings : every other number. progress : "auto", "terminal", "plain", "notebook", "silent", or a Progress.

    Returns the Run; the folder holds run.toml, archive.sqlite, best.py, best.json, trajectory.csv, selection.json and
    report.html. Raises IbridError for wrong options, a folder that cannot be used, or a start without a fit.
    """
    began = time.monotonic()
    settings = replace(settings or SearchSettings(), history=history)
    plan = make_plan(sweep, parameters, equilibrium, vocabulary, None, None, seed, holdout_op, None)
    first = _program(start)
    require_legal(parse_program(first, "the start"), plan.kinds, equilibrium=equilibrium)
    proposers = choose_proposers(proposer, models, limits)
    if any(isinstance(one, Agent) for one, _ in proposers):
        settings = replace(settings, pruning=0.0)  # an agent sees the results of its own steps alone
    requirements = parse_requirements(require)
    _require_numbers(budget, target, workers, history, choose)
    held = tuple(point.op.name for point in plan.held_out)
    if choose == "op" and not held:
        raise IbridError("choosing by held-out operating points needs some; name them with --holdout-op")
    options = {
        "seed": seed, "budget": budget, "target": target, "proposer": _names(proposers), "models": list(models),
        "parameters": parameters, "equilibrium": equilibrium, "vocabulary": plan.vocabulary, "holdout_op": list(held),
        "require": require or "", "choose": choose, "workers": workers, "ray": ray or "", "data": sweep.source,
        "data_sha256": _digest(sweep_csv(sweep)), "start_sha256": _digest(first), "settings": vars(settings),
    }  # fmt: skip
    folder = _folder(folder)
    meta = {"data": sweep_csv(sweep), "start": first, "truth": "" if truth is None else program_text(truth)}
    with _opened(folder, options, meta, resume) as store:
        shown = Progress(progress) if isinstance(progress, str) else progress
        judged = criterion(plan.fitted, parameters, settings)
        subject = Subject(with_sigma(sweep), parameters, equilibrium, plan.kinds, held, seed=seed, floor=judged.floor)
        task = Task(plan.fitted, plan.kinds, equilibrium, parameters)
        watcher = _Watcher(store, folder, shown, budget)
        with _evaluator(subject, workers, ray, settings) as evaluator, shown:
            loop = Loop(
                task, store, evaluator, proposers, settings, Goal(budget, target), seed=seed, criterion=judged,
                requirements=requirements, watch=watcher,
            )  # fmt: skip
            _remember(proposers, store)
            with _keyboard(loop, shown):
                ending = loop.run(first)
        answer, selection = _concluded(loop, store, subject, choose, folder, ending)
        points = trajectory(loop.steps)
        write_run_page(store, folder / PAGE, vocabulary=plan.kinds)
        return Run(
            folder=folder,
            best=answer,
            ending=ending,
            evaluations=len(points),
            seconds=time.monotonic() - began,
            trajectory=tuple((one.evaluation, one.nrmse, one.best) for one in points),
            statuses={str(status): number for status, number in counts(loop.steps).items()},
            selection=selection,
            finished=ending != STOPPED,
        )


def _folder(folder: str | Path) -> Path:
    if not str(folder).strip():
        raise IbridError("a run needs a folder for its files, found an empty name; write . for the current one")
    return Path(folder)


def _program(start: Diagram | str | None) -> str:
    if start is None:
        return textbook_text("naive")
    return program_text(start) if isinstance(start, Diagram) else start


def _require_numbers(budget: int, target: float | None, workers: int, history: int, choose: str) -> None:
    for holds, sentence in (
        (budget >= 1, f"budget must be 1 evaluation or more, found {budget}"),
        (target is None or target > 0, f"target must be an NRMSE above zero, found {target}"),
        (workers >= 1, f"workers must be 1 or more, found {workers}"),
        (history >= 0, f"history must be 0 or more, found {history}"),
        (choose in WAYS, f"the answer is chosen by {', '.join(WAYS)}, found {choose!r}"),
    ):
        if not holds:
            raise IbridError(sentence)


def _names(proposers: Sequence[tuple[Proposer, float]]) -> str:
    return ",".join(f"{one.name}:{weight:g}" for one, weight in proposers)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@contextmanager
def _opened(folder: Path, options: Mapping[str, Any], meta: Mapping[str, str], resume: bool) -> Iterator[Store]:
    """The store of a new run, or of the one in the folder when it may be resumed.

    A new run that ends with an IbridError before there is a start to search from leaves nothing behind.
    """
    archive, file = folder / ARCHIVE, folder / RUN_TOML
    exists = archive.exists() or file.exists()
    if exists and not resume:
        raise IbridError(f"{folder}: holds a run already; go on with it by --resume, or choose another folder")
    if not exists:
        _make(folder)
        write_whole(file, run_toml(options))
    texts = {**meta, "settings": run_toml(options), "started": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
    fresh = not archive.exists() or archive.stat().st_size == 0
    begun = True
    try:
        with Store.create(archive, texts) if fresh else Store.open(archive) as store:
            if exists:
                require_same(read_run_toml(_options_text(file, store), str(file)), options, str(file))
            try:
                yield store
            except IbridError:
                begun = exists or any(step.status in USABLE for step in store.steps())
                raise
    finally:
        if not begun:
            for name in (RUN_TOML, ARCHIVE, *BESIDE_ARCHIVE):
                (folder / name).unlink(missing_ok=True)


def _options_text(file: Path, store: Store) -> str:
    """The text of run.toml, or the copy in the store when the file is gone."""
    try:
        return file.read_text(encoding="utf-8")
    except FileNotFoundError:
        return store.meta.get("settings", "")
    except (OSError, UnicodeDecodeError):
        raise IbridError(f"{file}: must be a text that can be read; restore it, or start a new run") from None


def _make(folder: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise IbridError(f"{folder}: is not a folder; choose another place for the run")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise IbridError(f"{folder}: cannot be made ({error.strerror}); choose another place for the run") from None
    for name in (BEST_PROGRAM, BEST_RECORD, TRAJECTORY, SELECTION, PAGE):
        if (folder / name).exists():
            raise IbridError(f"{folder}: holds {name}, which the run would overwrite; choose another folder")


def _evaluator(subject: Subject, workers: int, ray: str | None, settings: SearchSettings) -> Evaluator:
    if workers == 1 and ray is None:
        return LocalEvaluator(subject, wall=settings.wall)
    from search.evaluation.ray_actors import RayEvaluator  # Ray is an extra, and slow to import

    return RayEvaluator(subject, workers, address=ray, wall=settings.wall, lost=settings.lost)


@contextmanager
def _keyboard(loop: Loop, shown: Progress) -> Iterator[None]:
    """The first Ctrl-C lets the loop finish what is under way; the second stops at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        if loop.stop_asked:
            loop.halt_asked = True
            raise KeyboardInterrupt
        loop.stop_asked = True
        shown.say("Finishing what is under way; a second Ctrl-C stops at once. Go on later with --resume.")

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _remember(proposers: Sequence[tuple[Proposer, float]], store: Store) -> None:
    """Give an agent the store to look back at, and count what language models spent in earlier sittings."""
    for one, _ in proposers:
        if isinstance(one, Agent):
            one.history = store
        if isinstance(one, Agent | LanguageModel):
            for step in store.steps():
                if step.proposer == one.name:
                    one.count(step.usage)


class _Watcher:
    """Keeps the files of the best and the display up to date as steps are absorbed; of those of an earlier sitting it
    only takes note."""

    def __init__(self, store: Store, folder: Path, shown: Progress, budget: int) -> None:
        self.store, self.folder, self.shown, self.budget = store, folder, shown, budget
        self.mark: float | None = None
        self.counts: Counter[Status] = Counter()
        self.evaluation = 0
        self.started = False

    def __call__(self, loop: Loop, step: Step) -> None:
        if not self.started:
            self.started = True
            self.shown.start(self.budget, sum(one.status in EVALUATED for one in loop.steps))
        self.evaluation += step.status in EVALUATED
        self.counts[step.status] += step.number > 0
        if step.number < loop.restored:
            if loop.best is step and improves(self.mark, step.nrmse or 0.0):
                self.mark = step.nrmse
            if step.number == loop.restored - 1 and loop.best is not None:
                self._keep(loop, loop.best)
        elif loop.best is step:
            self._keep(loop, step)
            self._tell(loop, step)
        self.shown.update(Snapshot(step.number, self.evaluation, self.mark, Tally.of(self.counts)))

    def _keep(self, loop: Loop, step: Step) -> None:
        write_best(self.folder, loop.record(step.number))
        self.store.set_meta("best", str(step.number))

    def _tell(self, loop: Loop, step: Step) -> None:
        before = self.mark
        if not improves(before, step.nrmse or 0.0):
            return  # as good, and simpler
        parent = None if step.parent is None else loop.steps[step.parent]
        records = (loop.record(step.number), None if parent is None else loop.record(parent.number))
        self.mark = step.nrmse
        self.shown.milestone(milestone_row(milestone(self.evaluation, step, before, parent, *records)))


def write_best(folder: Path, record: Record) -> None:
    """best.py and best.json, each replaced atomically."""
    write_whole(folder / BEST_PROGRAM, record.program)
    record.write(folder / BEST_RECORD)


def _concluded(
    loop: Loop, store: Store, subject: Subject, choose: str, folder: Path, ending: str
) -> tuple[Record | None, Mapping[str, Any]]:
    """Fit the answer with full effort and write the files that sum the run up."""
    write_whole(folder / TRAJECTORY, trajectory_csv(trajectory(loop.steps)))
    store.set_meta("ending", ending)
    if loop.best is None:
        return None, {}
    if ending == STOPPED:
        return loop.record(loop.best.number), {}
    selection = select(loop.steps, loop.best, loop.record, subject, loop.criterion.floor, loop.error, choose)
    write_whole(folder / SELECTION, selection_json(selection))
    found = loop.record(selection["answer"])
    again = subject.record_of(found.program, FitSettings(), found.parameters)
    if (
        again.outcome == Outcome.OK
        and subject.error(again) <= subject.error(found)
        and all(again.stable.values())
        and not loop.requirements.unmet(again)
    ):
        found = again
    store.set_meta("best", str(selection["answer"]))
    write_best(folder, found)
    return found, selection
