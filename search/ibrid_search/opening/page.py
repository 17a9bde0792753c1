"""The page of a story, report.html."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.report.block_diagrams.block_diagram import Shown, drawn_diagrams, readable
from ibrid.report.pages.page import record_facts
from ibrid.report.pages.template import page
from ibrid.writing import inside, write_whole
from ibrid_search.opening.predicting import prediction_figures
from ibrid_search.opening.story import OpeningStory

PAGE, RECORDINGS = "report.html", "events.csv"


def write_page(story: OpeningStory, answer: Record, sweep: Sweep, folder: Path) -> None:
    """Write report.html to the folder.

    sweep : all that was fitted, the held-out one not among it.
    """
    facts = record_facts(answer, sweep, "bode", title=_headline(story, answer))
    context = {
        **facts,
        "story": story,
        "growing": _growing(story, answer),
        "simulated_s": sum(experiment.simulated_s for experiment in story.experiments),
        "held": prediction_figures(answer, story.held_out, folder),
        "exports": _exports(story, answer, folder),
    }
    write_whole(inside(folder, PAGE), page("open.html", context, "ibrid_search"))


def _headline(story: OpeningStory, answer: Record) -> str:
    """Name of the diagram, its grade, and how many rivals are left."""
    diagram = readable(answer.program)
    name = diagram.name.removeprefix("build_") if diagram is not None else "model"
    rivals = len(story.answer["rivals"])
    left = "no rival left" if not rivals else f"{rivals} rival{'s' * (rivals > 1)} left"
    return f"{name}: {story.answer['grade'] or 'no grade'}, {left}"


def _growing(story: OpeningStory, answer: Record) -> Any:
    """The diagram after each experiment that changed it; None where one would be shown twice."""
    shown = []
    seen = ""
    for number, experiment in enumerate(story.experiments, 1):
        changed = experiment.answer and experiment.answer != seen
        diagram = readable(experiment.answer) if changed else None
        if diagram is not None:
            shown.append(Shown(f"after experiment {number}", diagram))
            seen = experiment.answer
    return drawn_diagrams(shown, answer.vocabulary) if len(shown) > 1 else None


def _exports(story: OpeningStory, answer: Record, folder: Path) -> Sequence[tuple[str, str]]:
    """What a user may want next, and the command that makes it."""
    record = str(folder / story.answer["record"])
    op = next(iter(answer.parameters), "")
    page_of_grids = str(folder / "stability.html")
    named = ["ibrid", "export", record, "--op", op]
    commands = [
        (
            "the linear model at an operating point, as matrices",
            [*named, "--format", "control-json", "--out", str(folder / "linear.json")],
        ),
        (
            "the averaged model before linearisation, as an FMU",
            [*named, "--nonlinear", "--format", "fmu", "--out", str(folder / "model.fmu")],
        ),
        (
            "stability on grids from weak to strong",
            ["ibrid", "stability", record, "--scr", "1.5:10", "--report", page_of_grids],
        ),
    ]
    if (folder / RECORDINGS).is_file():
        events = str(folder / RECORDINGS)
        words = "the generic planning model (REGC_A, REEC_A) nearest to the recordings, as a .dyr"
        commands.append((words, ["ibrid", "generic", events, "--out", str(folder / "generic")]))
    return [(words, shlex.join(command)) for words, command in commands]
