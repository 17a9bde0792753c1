"""The milestones of a search as a table of text, as wide as where it is shown."""

from textwrap import wrap

from ibrid.report.numbers import error
from ibrid_search.trajectory import Milestone

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


def milestone_row(one: Milestone, width: int) -> tuple[str, ...]:
    """Evaluation, what changed, the best NRMSE with it, and which band got better; a long note goes on below."""
    room = _room(width)
    notes = wrap(printable(one.note), room, max_lines=LINES, placeholder=" ...") or [""]
    band = f"{one.band}, {error(one.band_before)} -> {error(one.band_after)}" if one.band else ""
    first = _line(str(one.evaluation), notes[0], error(one.after), band, width)
    return first, *(" " * (EVALUATION + 2) + line for line in notes[1:])


def printable(text: str) -> str:
    """The text on one line, without what would move the cursor: notes come from outside."""
    return "".join(one if one.isprintable() else " " for one in text)


def _line(evaluation: str, note: str, nrmse: str, band: str, width: int) -> str:
    return f"{evaluation:>{EVALUATION}}  {note:<{_room(width)}}  {nrmse:<{NRMSE}}  {band}".rstrip()


def _room(width: int) -> int:
    return max(CHANGED, min(width, WIDEST) - EVALUATION - NRMSE - BAND - 6)
