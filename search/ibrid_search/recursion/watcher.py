"""What is kept up to date while a search goes on: the files of the best, the display, time and
tokens that it has taken.
"""

import math
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from ibrid_search.chat.spending import Spending, without_numbers
from ibrid_search.recursion.loop import Loop
from ibrid_search.recursion.progress import Progress, Snapshot
from ibrid_search.run.run_folder import write_best
from ibrid_search.run.stop_request import is_stop_requested
from ibrid_search.run.store import Store
from ibrid_search.run.tally import Tally
from ibrid_search.run.trajectory import improves, milestone
from ibrid_search.step import EVALUATED, Status, Step

#: The text of the store that says how long all sittings took together.
SECONDS = "seconds"
#: Ends of a question that say something of the model that was asked.
_USELESS = (Status.NO_ANSWER, Status.NO_EDIT, Status.UNREADABLE)


class Watcher:
    """Called with every step once its result is in, in their order; of those of an earlier sitting
    it only takes note.

    `spending` : of language models, in all sittings.
    """

    def __init__(self, store: Store, folder: Path, shown: Progress, budget: int) -> None:
        self.store, self.folder, self.shown, self.budget = store, folder, shown, budget
        self.spending = Spending()
        self._began = time.monotonic() - seconds_of(store.meta)
        self._mark: float | None = None  # the best NRMSE that was told
        self._counts: Counter[Status] = Counter()
        self._evaluation = 0
        self._started = False
        self._complaints: set[str] = set()

    def __call__(self, loop: Loop, step: Step) -> None:
        if not self._started:
            self._started = True
            self.shown.start(self.budget, sum(one.status in EVALUATED for one in loop.steps))
        self._evaluation += step.status in EVALUATED
        self._counts[step.status] += step.number > 0
        self.spending.count(step.usage)
        if step.number < loop.restored:
            if loop.best is step and improves(self._mark, step.nrmse or 0.0):
                self._mark = step.nrmse
            if step.number == loop.restored - 1 and loop.best is not None:
                self._keep(loop, loop.best)
        else:
            self.store.set_meta(SECONDS, f"{time.monotonic() - self._began:.3f}")
            self._complain(step)
            if loop.best is step:
                self._keep(loop, step)
                self._tell(loop, step)
        self._heed(loop)
        tally = Tally.of(self._counts)
        self.shown.update(
            Snapshot(step.number, self._evaluation, self._mark, tally, self.spending.words)
        )

    def _heed(self, loop: Loop) -> None:
        """End the search after what is under way where its live page asked for that."""
        if not loop.stop_asked and is_stop_requested(self.folder):
            loop.stop_asked = True
            self.shown.say(
                "Finishing what is under way: the live page asks to stop. Go on later with "
                "--resume."
            )

    def _keep(self, loop: Loop, step: Step) -> None:
        write_best(self.folder, loop.appraisal.record(step.number))
        self.store.set_meta("best", str(step.number))

    def _complain(self, step: Step) -> None:
        """Say what a language model or its server does wrong, each kind of it once."""
        kind = without_numbers(step.reason)
        if step.usage.get("model") and step.status in _USELESS and kind not in self._complaints:
            self._complaints.add(kind)
            self.shown.say(
                f"step {step.number}, {step.proposer}: {step.status}: {step.reason[:300]}"
            )

    def _tell(self, loop: Loop, step: Step) -> None:
        if not improves(self._mark, step.nrmse or 0.0):
            return  # as good, and simpler
        self._mark = step.nrmse
        parent = None if step.edited is None else loop.appraisal.record(step.edited)
        self.shown.milestone(
            milestone(self._evaluation, step, loop.appraisal.record(step.number), parent)
        )


def seconds_of(meta: Mapping[str, str]) -> float:
    """What all sittings took so far, by the texts of the store; 0 where they do not say it."""
    try:
        seconds = float(meta.get(SECONDS, ""))
    except ValueError:
        return 0.0
    return seconds if math.isfinite(seconds) and seconds > 0 else 0.0
