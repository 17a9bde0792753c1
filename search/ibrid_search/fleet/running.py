"""ibrid_search.fleet.running.fleet(folder, out): every device of a folder examined, in one store;
resumable at any moment.
"""

import time
from collections import deque
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.hanging import PROCESSOR_LIMIT, STILL
from ibrid.interrupts import hearing_interrupts
from ibrid.own_files import also_reading, writing_as
from ibrid.telling import Tell, silent
from ibrid.writing import inside, require_folder, write_whole
from ibrid_search.archives.prior import DeviceAnswer, Prior, learned, learned_from
from ibrid_search.evaluation.job import Evaluator, Result
from ibrid_search.evaluation.processes import ProcessEvaluator
from ibrid_search.evaluation.ray_session import require_cluster
from ibrid_search.fleet.devices import content_of, enlist, files_of
from ibrid_search.fleet.examining import JOBS, DeviceJob, Examiner
from ibrid_search.report.fleet_summary import Summary, fleet_html, summary_of, table_csv
from ibrid_search.run.run_folder import ARCHIVE, PAGE, TABLE, adopt_run, open_run, require_run
from ibrid_search.run.store import Store
from ibrid_search.settings import Workers
from ibrid_search.step import Status, Step

#: Devices that are handed over beyond those that are worked on, for each worker.
AHEAD = 1
#: What to do where drift has no model.
FIRST = "examine an earlier sweep of it there first"


@dataclass(frozen=True)
class Fleet:
    """What was found. `seconds` : of this sitting."""

    folder: Path
    summary: Summary
    seconds: float


@hearing_interrupts()
@writing_as("fleet")
def fleet(
    folder: str | Path,
    out: str | Path,
    *,
    job: str | Examiner = "start",
    before: str | Path | None = None,
    workers: int | Workers = 1,
    seed: int = 0,
    budget: int = 40,
    effort: str = "normal",
    processor_limit: float = PROCESSOR_LIMIT,
    still: int = STILL,
    resume: bool = False,
    tell: Tell = silent,
) -> Fleet:
    """Examine the device of every file in a folder.

    Parameters
    ----------
    folder : sweep files, one a device, also in folders below. out : the fleet's own folder; refused
    when it holds one already.
    job : "start": first look and shipped diagrams; "search": a search of `budget` evaluations;
    "drift": what changed since the
        fleet in the folder `before`, by names of files; or an Examiner of one's own, in a module
        that workers can import. Before start and search the structures of the fleet so far are
        tried.
    workers : so many processes of this machine; `ibrid_search.Workers` also names a Ray cluster.
    seed : of everything random. effort : "low", "normal" or "high", of each start or search.
    processor_limit, still : when the
        process of a device is taken for one that hangs and ended (`ibrid.hanging`), a safety net;
        the device is then unfinished.
    resume : go on with a fleet; files that are new are new devices.

    What a device's answer is depends on the devices before it, never on the workers. Raises
    IbridError for wrong options and folders that cannot be used; what is wrong with a device's file
    is told in its line of the table.
    """
    began = time.monotonic()
    folder, out = Path(folder), Path(out)
    workers = workers if isinstance(workers, Workers) else Workers(workers)
    require_cluster(workers.ray)
    examiner = Examiner(job, seed, budget, effort) if isinstance(job, str) else job
    job = examiner.job
    if job not in JOBS:
        raise IbridError(f"a fleet does {', '.join(JOBS)} for each device, found {job!r}")
    if (job == "drift") != (before is not None):
        raise IbridError(
            "drift is since an earlier fleet: give its folder, and give none for another job"
        )
    if resume:
        require_run(out)
        adopt_run(out)
    require_folder(out, (TABLE, PAGE))
    names = files_of(folder, out)
    also_reading({name: folder / name for name in names})
    stated = {
        "fleet": job,
        "seed": seed,
        "workers": workers.number,
        "ray": workers.ray or "",
        "settings": {"effort": effort, **({"budget": budget} if job == "search" else {})},
        "before": None if before is None else str(Path(before).resolve()),
    }
    with ExitStack() as opened:
        earlier = None if before is None else opened.enter_context(Earlier(Path(before)))
        store = opened.enter_context(
            open_run(out, stated, {"fleet": job, "folder": str(folder)}, resume)
        )
        steps = enlist(store, folder, names, job)
        crew = replace(workers, number=min(workers.number, max(1, len(steps))))
        with _evaluator(examiner, crew, processor_limit, still) as evaluator:
            _Course(store, folder, steps, evaluator, earlier, tell).run()
        summary = summary_of(store)
        write_whole(inside(out, TABLE), table_csv(summary))
        write_whole(inside(out, PAGE), fleet_html(summary))
    return Fleet(out, summary, time.monotonic() - began)


class _Course:
    """Devices in their order through the workers, few at a time, and what the next may learn from
    them.
    """

    def __init__(
        self,
        store: Store,
        folder: Path,
        steps: list[Step],
        evaluator: Evaluator,
        earlier: "Earlier | None",
        tell: Tell,
    ) -> None:
        self._store, self._folder, self._steps = store, folder, steps
        self._evaluator, self._earlier, self._tell = evaluator, earlier, tell
        self._answers: dict[int, DeviceAnswer] = {}
        self._known = Prior()
        self._open: set[int] = set()
        self._ended = 0  # so many from the first on have ended
        self._done = sum(step.status is not Status.PENDING for step in steps)
        self._learns = earlier is None

    def run(self) -> None:
        """Until every device has an end."""
        waiting = deque(step.number for step in self._steps if step.status is Status.PENDING)
        for step in self._steps:
            if step.status is Status.OK and self._learns:
                self._answers[step.number] = DeviceAnswer.of(self._store.record(step.number))
        most = self._evaluator.capacity * (1 + AHEAD)
        while waiting or self._open:
            self._count()
            while waiting and len(self._open) < most and self._horizon(waiting[0]) <= self._ended:
                self._begin(self._steps[waiting.popleft()])
                self._count()
            if self._open:
                self._conclude(self._evaluator.first_ended())

    def _horizon(self, number: int) -> int:
        return learned_from(number) if self._learns else 0

    def _count(self) -> None:
        while (
            self._ended < len(self._steps) and self._steps[self._ended].status is not Status.PENDING
        ):
            self._ended += 1

    def _begin(self, step: Step) -> None:
        try:
            content = content_of(self._folder, step)
            before = (
                {} if self._earlier is None else self._earlier.record(step.note, FIRST).to_json()
            )
        except IbridError as error:
            self._close(Result(step.number, Status.FAILED, None, str(error), 0.0, 1))
            return
        horizon = self._horizon(step.number)
        if horizon != self._known.devices:
            self._known = learned(
                (one for number, one in self._answers.items() if number < horizon), horizon
            )
        job = DeviceJob(
            step.number, "", name=step.note, content=content, prior=self._known, before=before
        )
        self._evaluator.submit(job)
        self._open.add(step.number)

    def _conclude(self, number: int) -> None:
        result = self._evaluator.collect(number)
        self._open.discard(number)
        self._close(result)
        if result.record is not None and result.outcome is Status.OK and self._learns:
            self._answers[number] = DeviceAnswer.of(result.record)

    def _close(self, result: Result) -> None:
        """Write how a device ended."""
        ended = {
            name: getattr(result, name) for name in ("reason", "record", "seconds", "attempts")
        }
        self._store.conclude(result.number, status=result.outcome, **ended)
        self._steps[result.number] = self._store.step(result.number)
        self._done += 1
        self._tell(f"{self._done} of {len(self._steps)} devices", self._done / len(self._steps))


def _evaluator(
    examiner: Examiner, workers: Workers, processor_limit: float, still: int
) -> Evaluator:
    if workers.ray is None:
        return ProcessEvaluator(
            examiner, workers.number, processor_limit=processor_limit, still=still
        )
    from ibrid_search.evaluation.ray_actors import (
        RayEvaluator,
    )  # Ray is an extra, and slow to import

    return RayEvaluator(examiner, workers.number, address=workers.ray)


class Earlier(AbstractContextManager["Earlier"]):
    """A fleet that was examined before. Raises IbridError for a folder that is none's."""

    def __init__(self, out: Path) -> None:
        self._out, self._store = out, Store.open(out / ARCHIVE, read_only=True)
        if "fleet" not in self._store.meta:
            raise IbridError(
                f"{out}: is the folder of a search; give the one of an earlier ibrid fleet"
            )
        self._numbers = {
            step.note: step.number for step in self._store.steps() if step.status is Status.OK
        }

    def record(self, name: str, hint: str = "") -> Record:
        """Of the device by the name of its file; IbridError where it has none, with a hint, or
        names that are near.
        """
        if name not in self._numbers:
            raise IbridError(
                f"{name}: {self._out} has no model of it; {hint or near(name, self._numbers)}"
            )
        return self._store.record(self._numbers[name])

    def __exit__(self, *_: object) -> None:
        self._store.close()
