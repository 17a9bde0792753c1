"""Live progress of a search: how far it is, how good, what becomes of the proposals, what it takes;
and milestones.
"""

import math
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import pairwise
from textwrap import wrap
from typing import TextIO

from ibrid.display import make_display
from ibrid.report.look.numbers import error
from ibrid_search.run.tally import Tally
from ibrid_search.run.trajectory import Milestone

#: Evaluations over which the rate is taken.
RECENT = 30
#: Evaluations before a time left is told.
FEWEST = 3
#: Largest part of their time that the wait for one of them may have taken then.
LONGEST_PART = 0.5


@dataclass(frozen=True)
class Snapshot:
    """Where a search stands. `step` : number of the last proposal. `evaluations` : begun and done,
    the start included.

    `best` : NRMSE of the best stable candidate, None before the first. `tally` : what became of the
    proposals. `spent` : by language models, in words.
    """

    step: int = 0
    evaluations: int = 0
    best: float | None = None
    tally: Tally = field(default_factory=Tally)
    spent: str = ""


class Progress(AbstractContextManager["Progress"]):
    """Shows snapshots and milestones where the user looks.

    show : "terminal", "plain", "notebook", "silent", or "auto" for what suits. every : seconds
    between plain lines.
    stream, out : for the state and for the milestones; the error stream and the standard output
    when not given.
    clock : seconds, for tests.

    Raises IbridError for any other `show`.
    """

    def __init__(
        self,
        show: str = "auto",
        *,
        every: float = 10.0,
        stream: TextIO | None = None,
        out: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        stream = sys.stderr if stream is None else stream
        out = sys.stdout if out is None else out
        self._display = make_display(show, stream, out, every)
        self._clock = clock
        self._total: int | None = None
        self._seen: deque[tuple[float, int]] = deque(maxlen=RECENT + 1)
        self._last: Snapshot | None = None
        self._drawn: Snapshot | None = None
        self._shown = -math.inf
        self._headed = False

    def start(self, total: int | None, done: int = 0) -> None:
        """Begin; `total` : evaluations at most, None for no limit. `done` : those of an earlier
        sitting of the same run.
        """
        self._total = total
        self._seen = deque([(self._clock(), done)], maxlen=RECENT + 1)

    def update(self, snapshot: Snapshot) -> None:
        """Take note of where the search stands, and show it unless that was done just now."""
        now = self._clock()
        self._last = snapshot
        if not self._seen:
            self._seen.append((now, snapshot.evaluations))
        if snapshot.evaluations != self._seen[-1][1]:
            self._seen.append((now, snapshot.evaluations))
        if now - self._shown >= self._display.pause:
            self._draw(now)

    def milestone(self, reached: Milestone) -> None:
        """Print a milestone as a row of a table that is as wide as the display; its head comes
        before the first.
        """
        columns = self._display.columns
        lines = milestone_row(reached, columns)
        if not self._headed:
            self._headed = True
            lines = (*milestone_head(columns), *lines)
        for line in lines:
            self._display.row(line)

    def aside(self, text: str) -> None:
        """Show for a moment what keeps the search, in place of where it stands."""
        now = self._clock()
        if now - self._shown >= self._display.pause:
            self._display.state(printable(text)[: self._display.width])
            self._shown = now

    def say(self, text: str) -> None:
        """Print a line that stays."""
        self._display.row(printable(text))

    def finish(self) -> None:
        """Show the last state, once, and leave the line; where it is kept, without the time that
        would have been left.
        """
        if self._last is not None and (self._last is not self._drawn or self._display.kept):
            self._draw(self._clock(), ended=True)
        self._last = None
        self._display.close()

    def __exit__(self, *_: object) -> None:
        self.finish()

    def _is_steady(self, now: float) -> bool:
        """Whether evaluations end so evenly that their rate tells how long the others take."""
        times = [*(time for time, _ in self._seen), now]
        longest = max(after - before for before, after in pairwise(times))
        return len(self._seen) > FEWEST and longest <= LONGEST_PART * (now - times[0])

    def _draw(self, now: float, *, ended: bool = False) -> None:
        if self._last is not None:
            began, before = self._seen[0]
            done = self._last.evaluations - before
            rate = done / (now - began) if done > 0 and now > began else None
            over = ended or not self._is_steady(now)
            text = progress_line(self._last, self._total, rate, self._display.width, over=over)
            share = (
                None if ended or not self._total else min(self._last.evaluations / self._total, 1.0)
            )
            self._display.state(text, share)
            self._shown, self._drawn = now, self._last


def progress_line(
    snapshot: Snapshot,
    total: int | None,
    rate: float | None,
    width: int | None = None,
    *,
    over: bool = False,
) -> str:
    """One line, with shorter words, and at last without the shares, where the width does not allow
    more.

    rate : evaluations per second, None while it is not known. over : no time that is left is told,
    since nothing follows or nobody knows.
    """
    tally = snapshot.tally
    if total is not None and snapshot.evaluations > total:
        total = None  # a run that goes on may be given a smaller budget than it has used
    far = f"{snapshot.evaluations}/{total}" if total is not None else str(snapshot.evaluations)
    good = f"best {error(snapshot.best)}"
    if rate is not None:
        good += f", {rate:.3g}/s"
        if total is not None and not over:
            good += f", ETA {clock_time(max(0, total - snapshot.evaluations) / rate)}"
    if snapshot.spent:
        good += f", {snapshot.spent}"
    names = ["valid", "duplicate", "unchanged", "refused", *(["failed"] if tally.failed else [])]
    long = "  ".join(f"{name} {tally.share(name):.0%}" for name in names)
    short = " ".join(f"{name[:3]} {tally.share(name):.0%}" for name in names)
    main = f"{far} evaluations, step {snapshot.step}, {good}"
    for line in (f"{main} | {long}", f"{main} | {short}", f"{far}, {good} | {short}"):
        if width is None or len(line) <= width:
            return line
    return main[:width]


def clock_time(seconds: float) -> str:
    """A duration as h:mm:ss or m:ss."""
    if seconds >= 360_000:  # a hundred hours: nobody waits for the minutes
        return f"{seconds / 86_400:.0f} days"
    whole = round(seconds)
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours}:{minutes:02}:{whole % 60:02}" if hours else f"{minutes}:{whole % 60:02}"


#: Characters of the columns; what changed takes the rest of the width, but no less than its own.
EVALUATION, CHANGED, NRMSE, BAND = 10, 16, 9, 29
#: Characters of the whole table at most: where a window is wider, the eye would lose the row.
WIDEST = 130
#: Lines that a note may take.
LINES = 4


def milestone_head(width: int) -> tuple[str, str]:
    """The names of the columns and a rule."""
    names = _line("evaluation", "what changed", "NRMSE", "band (Hz) that got better", width)
    return names, "-" * max(min(width, WIDEST), len(names))


def milestone_row(milestone: Milestone, width: int) -> tuple[str, ...]:
    """Evaluation, what changed, the best NRMSE with it, and which band got better; a long note goes
    on below.
    """
    notes = wrap(printable(milestone.note), _room(width), max_lines=LINES, placeholder=" ...") or [
        ""
    ]
    fell = f"{error(milestone.band_before)} -> {error(milestone.band_after)}"
    band = f"{milestone.band}, {fell}" if milestone.band else ""
    first = _line(str(milestone.evaluation), notes[0], error(milestone.after), band, width)
    return first, *(" " * (EVALUATION + 2) + line for line in notes[1:])


def printable(text: str) -> str:
    """The text on one line, without what would move the cursor: notes come from outside."""
    return "".join(one if one.isprintable() else " " for one in text)


def _line(evaluation: str, note: str, nrmse: str, band: str, width: int) -> str:
    return f"{evaluation:>{EVALUATION}}  {note:<{_room(width)}}  {nrmse:<{NRMSE}}  {band}".rstrip()


def _room(width: int) -> int:
    return max(CHANGED, min(width, WIDEST) - EVALUATION - NRMSE - BAND - 6)
