"""How the search went: the trajectory, the milestones, and the line of descent of what was found."""

import math

import numpy as np

from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.markup import (
    cell,
    data,
    difference_html,
    error_cell,
    escape,
    head,
    paragraph,
    program,
    table,
)
from ibrid.report.numbers import error
from ibrid.report.trajectory import Trajectory, draw_trajectory
from ibrid_search.lineage import Ancestor, lineage
from ibrid_search.report.run_data import RunData
from ibrid_search.trajectory import Milestone

#: Characters of a note that a table shows, and of one in the figure.
NOTE, LABEL = 160, 36
#: Other edits of an ancestor that are listed.
OTHERS = 6


def trajectory_html(run: RunData) -> str:
    """Figure and milestone table, or a sentence before the first evaluation."""
    if not run.points:
        return paragraph("Nothing has been evaluated yet.")
    first, last = run.points[0], run.points[-1]
    label = f"NRMSE on a logarithmic scale over {last.evaluation} evaluations; the table below gives the milestones."
    if last.best is not None:
        label += f" The best is {error(last.best)}."
    svg = inline_svg(
        lambda axes: draw_trajectory(axes, _figure_data(run)), name="trajectory", label=label, size=(11.5, 4.4)
    )
    words = (
        "Dots: every evaluated candidate; crosses: unstable ones, which are shown and never count as best. Line: the best "
        "so far. What lies beyond an edge is drawn at it."
    )
    if first.step == 0:
        words = f"Evaluation 1 is the start. {words}"
    return paragraph(words, "note") + figure_html(svg, style="broad") + _milestone_table(run)


def _figure_data(run: RunData) -> Trajectory:
    points = run.points

    def column(values: list[float | None]) -> np.ndarray:
        return np.array([math.nan if value is None else value for value in values], dtype=float)

    target = run.settings.get("target")
    return Trajectory(
        evaluation=np.array([one.evaluation for one in points], dtype=float),
        nrmse=column([one.nrmse for one in points]),
        stable=np.array([one.stable for one in points]),
        best=column([one.best for one in points]),
        milestones=tuple(
            (one.evaluation, one.after, f"{shortened(one.note, LABEL)}  {error(one.after)}") for one in run.milestones
        ),
        floor=None if run.record is None else run.record.noise_floor,
        target=float(target) if isinstance(target, int | float) and not isinstance(target, bool) else None,
    )


def _milestone_table(run: RunData) -> str:
    if not run.milestones:
        return paragraph("No stable candidate has been fitted yet, so there are no milestones.")
    rows = "".join(_milestone_row(one) for one in run.milestones)
    names = ["evaluation", "step", "what changed", "best before", "NRMSE", "band that got better", "error there"]
    return table(
        "Milestones",
        "Every accepted improvement. The band is the one whose part of the squared error fell most, from the record of the "
        "edited parent to the record of the child.",
        head(names, numeric=(0, 1, 3, 4)) + f"<tbody>{rows}</tbody>",
    )


def _milestone_row(one: Milestone) -> str:
    band, there = "", ""
    if one.band:
        band = f"{one.band.replace('-', '–')} Hz"
        there = f"{error(one.band_before)} → {error(one.band_after)}"
    cells = [
        cell(str(one.step), numeric=True),
        cell(shortened(one.note), wraps=True),
        error_cell(one.before),
        error_cell(one.after),
        cell(band),
        cell(there),
    ]
    return f'<tr><th scope="row" class="n">{one.evaluation}</th>{"".join(cells)}</tr>'


def lineage_html(run: RunData) -> str:
    """The way from the start to the answer, each edit folded out on demand."""
    if run.answer is None:
        return paragraph("Nothing has been found yet.")
    path = lineage(run.steps, run.answer.number)
    evaluations = {one.step: one.evaluation for one in run.points}
    items = "".join(f"<li>{_ancestor(one, evaluations)}</li>" for one in path)
    words = f"{len(path) - 1} edits lead from step {path[0].step.number} to what was found; each opens to its program lines."
    return paragraph(words, "note") + f"<ol>{items}</ol>"


def _ancestor(one: Ancestor, evaluations: dict[int, int]) -> str:
    step = one.step
    place = f"step {step.number}" + (f", evaluation {evaluations[step.number]}" if step.number in evaluations else "")
    title = shortened(step.note) or ("the start" if step.parent is None else "an edit without a note")
    made = ", ".join(word for word in (step.scale and f"{step.scale} edit", step.proposer) if word)
    value = f"NRMSE {data(step.nrmse, error(step.nrmse))}" if step.nrmse is not None else escape(str(step.status))
    summary = (
        f"<summary><strong>{escape(title)}</strong> · {value} "
        f'<span class="note">· {escape(place)}{escape(f" · {made}" if made else "")}</span></summary>'
    )
    body = paragraph(shortened(step.diagnosis, 2000)) if step.diagnosis else ""
    body += difference_html(one.difference) if one.difference else program(step.program)
    return f"<details>{summary}{body}{_others(one)}</details>"


def _others(one: Ancestor) -> str:
    if not one.others:
        return ""
    listed = "; ".join(
        f"{shortened(other.note, 60) or 'no note'} ({error(other.nrmse)}{'' if other.stable else ', unstable'})"
        for other in one.others[:OTHERS]
    )
    more = f"; {len(one.others) - OTHERS} more" if len(one.others) > OTHERS else ""
    return paragraph(f"Other edits of the same parent, by error: {listed}{more}.", "note")


def shortened(text: str, longest: int = NOTE) -> str:
    """One line of at most `longest` characters."""
    text = " ".join(text.split())
    return text if len(text) <= longest else text[: longest - 1].rstrip() + "…"
