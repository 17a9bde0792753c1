"""ibrid.search(sweep, folder): a whole search, from the data to the chosen answer and its files; resumable at any moment."""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ibrid.errors import IbridError
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.fit.settings import FitSettings
from ibrid.measurement.csv_file import sweep_csv
from ibrid.measurement.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.structure.check import require_legal
from ibrid.structure.diagram import Diagram
from ibrid.structure.library import textbook_text
from ibrid.structure.program import parse_program, program_text
from ibrid.study import Study
from ibrid.writing import inside, write_whole
from ibrid_search.evaluation.assess import Assessor
from ibrid_search.evaluation.job import Evaluator
from ibrid_search.evaluation.local import LocalEvaluator
from ibrid_search.keyboard import keyboard
from ibrid_search.loop import STOPPED, Goal, Loop
from ibrid_search.page import write_run_page
from ibrid_search.panel import Panel
from ibrid_search.policy_package import policy_part
from ibrid_search.progress import Progress
from ibrid_search.proposal import Proposer
from ibrid_search.proposers.choose import choose_proposers
from ibrid_search.requirements import parse_requirements
from ibrid_search.run_file import digest
from ibrid_search.run_folder import PAGE, SELECTION, TRAJECTORY, open_run, require_run, write_best
from ibrid_search.selecting import WAYS, select, selection_json
from ibrid_search.settings import SearchSettings
from ibrid_search.spending import Limits, Prices
from ibrid_search.store import Store
from ibrid_search.tally import counts
from ibrid_search.trajectory import trajectory, trajectory_csv
from ibrid_search.watcher import Watcher

#: A search that learns goes on for so many batches without a new structure, since a policy may have to learn to make any.
PATIENT = 4


@dataclass(frozen=True)
class Run:
    """What a search found. `best` : record of the answer, None when no candidate was valid. `ending` : why it ended.

    `trajectory` : (evaluation, nrmse, best so far). `selection` : the content of selection.json. `seconds` : of this
    sitting. `spent` : tokens, cost and seconds of language models in all sittings. `finished` : False when it was stopped and
    can be resumed.
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

    def _repr_html_(self) -> str:
        """How it went and what was found, for notebooks."""
        from ibrid.report.notebook import search_html  # figures are slow to import, and rarely asked for

        return search_html(self.folder, self.best, self.ending, self.evaluations, self.trajectory)


def search(
    sweep: Sweep,
    folder: str | Path,
    *,
    start: Diagram | str | None = None,
    proposer: str | Proposer | Sequence[tuple[Proposer, float]] = "rules",
    models: Sequence[str] = (),
    limits: Limits | None = None,
    prices: Prices = (),
    policy: str | Path | None = None,
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
    learn: Any = False,
    resume: bool = False,
    settings: SearchSettings | None = None,
    progress: Progress | str = "silent",
) -> Run:
    """Search for the block diagram of a measured inverter.

    Parameters
    ----------
    sweep : measured operating points. folder : where the run lives; refused when it holds one already, and with
        `resume` when it holds none.
    start : diagram or program text to begin from; the naive one when not given.
    proposer : "rules", "random", "policy", "llm", "agent", a mix such as "rules:0.7,random:0.3", or proposers of one's own.
    models : for "llm" and "agent": "NAME@URL*WEIGHT" or folders of local models. limits : what they
        may spend in the whole run, `ibrid_search.spending.Limits`. prices : of a million tokens in and a million out;
        one pair for all models, or one for each.
    policy : folder of the weights for "policy", as `ibrid policy train` makes it; None: those that ship.
    budget : evaluations at most, the start included. target : NRMSE that ends the search; None: only the
        noise floor or an exact fit does.
    seed : of everything random; the same seed gives the same archive, whatever the number of `workers`.
    workers : 1 evaluates in this process, more on a local Ray. ray : address of a Ray cluster.
    parameters, equilibrium, vocabulary, holdout_op : as for `ibrid.evaluate`.
    history : best candidates and last failures that a proposer sees beside the parent; 0 is the paper's setting.
    require : "stable", "passive:LO-HI", joined by commas; what does not meet it is not admitted.
    choose : the answer by "error", held-out "frequencies", or held-out operating points ("op").
    truth : shown beside the answer; the search itself never sees it. One that is given with `resume` takes the place of an
        earlier one, and nothing else changes.
    learn : train the proposer on the way, "policy" or "llm" with one local folder, "FOLDER@URL" where a server answers for
        it; True or "paper" is the paper's profile, batches of 512, "small" one for a few hundred evaluations; or
        `ibrid_policy.learning.settings.LearningSettings`. Needs the distribution ibrid-policy.
    settings : every other number. progress : "auto", "terminal", "plain", "notebook", "silent", or a Progress.

    Returns the Run; the folder holds run.toml, archive.sqlite, best.py, best.json, trajectory.csv, selection.json and
    report.html. Raises IbridError for wrong options, a folder that cannot be used, or a start without a fit.
    """
    began = time.monotonic()
    folder = _folder(folder)
    if resume:
        require_run(folder)
    settings = replace(settings or SearchSettings(), history=history)
    study = Study.of(
        sweep, parameters=parameters, equilibrium=equilibrium, vocabulary=vocabulary, holdout_op=holdout_op, seed=seed
    )
    first = _program(start)
    require_legal(parse_program(first, "the start"), study.kinds, equilibrium=equilibrium)
    proposers = choose_proposers(proposer, models, limits, prices, policy)
    lessons: dict[str, Any] = {}
    if policy is not None:
        lessons = {
            "policy": str(policy),
            "policy_sha256": digest((Path(policy) / policy_part("weights_folder").WEIGHTS_FILE).read_bytes()),
        }
    if learn or isinstance(learn, str):  # an empty name is refused as any other
        known = policy_part("learning.settings")
        named = "paper" if learn is True else learn
        lesson = known.profile(named) if isinstance(named, str) else named
        proposers = policy_part("learning.choose").learning(
            proposers, lesson, seed=seed, window=settings.window, study=study.blind, start=first, folder=folder
        )
        settings = replace(settings, patience=max(settings.patience, PATIENT * lesson.steps))
        lessons["learning"] = vars(lesson)
    panel = Panel(proposers)
    if panel.undisturbed:
        settings = replace(settings, pruning=0.0)
    requirements = parse_requirements(require)
    _require_numbers(budget, target, workers, history, choose)
    held = study.held
    if choose == "op" and not held:
        raise IbridError("choosing by held-out operating points needs some; name them with --holdout-op")
    texts = {"data": sweep_csv(study.sweep), "start": first, "truth": "" if truth is None else program_text(truth)}
    options = {
        "seed": seed, "budget": budget, "target": target, "proposer": panel.names, "models": list(models),
        "prices": [list(one) for one in prices], "parameters": parameters, "equilibrium": equilibrium,
        "vocabulary": study.vocabulary_name, "holdout_op": list(held), "require": require or "", "choose": choose,
        "workers": workers, "ray": ray or "", "data": sweep.source, "data_sha256": digest(texts["data"]),
        "start_sha256": digest(first), "settings": vars(settings), **lessons,
    }  # fmt: skip
    with open_run(folder, options, texts, resume) as store:
        if truth is not None:
            store.set_meta("truth", texts["truth"])
        store.set_meta("ending", "")
        shown = Progress(progress) if isinstance(progress, str) else progress
        assessor = Assessor(study)
        watcher = Watcher(store, folder, shown, budget)
        with _evaluator(assessor, workers, ray, settings) as evaluator, shown:
            loop = Loop(
                study.blind, store, evaluator, panel, settings, Goal(budget, target),
                requirements=requirements, watch=watcher,
            )  # fmt: skip
            panel.begin(store, folder)
            with keyboard(loop, shown):
                ending = loop.run(first)
        with keyboard(loop, shown):  # a second Ctrl-C may come only now
            answer, selection = _concluded(loop, store, assessor, choose, folder, ending)
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


def _evaluator(assessor: Assessor, workers: int, ray: str | None, settings: SearchSettings) -> Evaluator:
    if workers == 1 and ray is None:
        return LocalEvaluator(assessor, wall=settings.wall)
    from ibrid_search.evaluation.ray_actors import RayEvaluator  # Ray is an extra, and slow to import

    return RayEvaluator(assessor, workers, address=ray, wall=settings.wall, lost=settings.lost)


def _concluded(
    loop: Loop, store: Store, assessor: Assessor, choose: str, folder: Path, ending: str
) -> tuple[Record | None, Mapping[str, Any]]:
    """Fit the answer with full effort and write the files that sum the run up."""
    worth = loop.appraisal
    write_whole(inside(folder, TRAJECTORY), trajectory_csv(trajectory(loop.steps)))
    store.set_meta("ending", ending)
    store.set_meta("archive", json.dumps(asdict(loop.archive.statistics())))
    if loop.best is None:
        return None, {}
    if ending == STOPPED:
        return worth.record(loop.best.number), {}
    selection = select(loop.steps, loop.best, worth.record, assessor, assessor.floor, worth.error, choose)
    seconds = selection.pop("seconds")  # the file is the same for the same seed
    write_whole(inside(folder, SELECTION), selection_json(selection))
    found = worth.record(selection["answer"])
    again = assessor.record_of(found.program, FitSettings(), found.parameters)
    store.set_meta("refits", str(seconds + again.seconds))
    if (
        again.outcome == Outcome.OK
        and assessor.floor.error(again) <= assessor.floor.error(found)
        and all(again.stable.values())
        and not loop.requirements.unmet(again)
    ):
        found = again
    store.set_meta("best", str(selection["answer"]))
    write_best(folder, found)
    return found, selection
