"""The page of a story, report.html."""

import shlex
from pathlib import Path

from ibrid.evaluation.record import Record
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.report.block_diagrams.block_diagram import Shown, drawn_diagrams, readable
from ibrid.report.pages.page import record_facts
from ibrid.report.pages.template import page
from ibrid.writing import inside, write_whole
from ibrid_search.opening.story import Story

PAGE = "report.html"


def write_page(
    story: Story, answer: Record, sweep: Sweep, events: Events | None, folder: Path
) -> None:
    """Write report.html to the folder."""
    del events
    facts = record_facts(answer, sweep, "bode")
    context = {
        **facts,
        "story": story,
        "growing": _growing(story, answer),
        "commands": _commands(folder, answer),
    }
    write_whole(inside(folder, PAGE), page("open.html", context, "ibrid_search"))


def _growing(story: Story, answer: Record):
    """The diagram after each experiment that changed it; None where one would be shown twice."""
    shown = []
    seen = ""
    for number, one in enumerate(story.experiments, 1):
        if one.answer and one.answer != seen and (diagram := readable(one.answer)) is not None:
            shown.append(Shown(f"after experiment {number}", diagram))
            seen = one.answer
    return drawn_diagrams(shown, answer.vocabulary) if len(shown) > 1 else None


def _commands(folder: Path, answer: Record) -> tuple[str, ...]:
    """Commands that export the model, and fit a generic one to what it answers."""
    record = str(folder / "model.json")
    op = next(iter(answer.parameters), "")
    linear = ["ibrid", "export", record, "--op", op, "--format", "control-json"]
    linear += ["--out", str(folder / "linear.json")]
    stability = ["ibrid", "stability", record, "--scr", "1.5:10"]
    stability += ["--report", str(folder / "stability.html")]
    generic = ["ibrid", "generic", str(folder / "held_out_event.csv")]
    generic += ["--out", str(folder / "generic")]
    return tuple(map(shlex.join, (linear, stability, generic)))
