"""How objects show themselves in notebooks: `_repr_html_` of diagrams, sweeps, records, gaps and searches.

An output stands alone: its style reaches nothing else, it runs no script and loads nothing.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.gap.result import Gap
from ibrid.measurement.quantities import hertz
from ibrid.measurement.sweep import PointSweep, Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.bode import Curves, bode_figures, curves
from ibrid.report.diagrams_beside import diagrams_beside, readable
from ibrid.report.error_table import error_tables
from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.gap_curves import point_views
from ibrid.report.gap_errors import summary_table
from ibrid.report.gap_page import gap_header
from ibrid.report.gap_program import diagrams_html, program_html
from ibrid.report.gap_tables import effect_html
from ibrid.report.legend import models_legend, points_legend
from ibrid.report.markup import bullets, cell, data, escape, folded, head, page_header, paragraph, program, row, table
from ibrid.report.measured_data import measured_data
from ibrid.report.notebook_output import output, tag
from ibrid.report.numbers import error, number
from ibrid.report.page import record_header
from ibrid.report.parameter_table import parameter_html, twins_table
from ibrid.report.trajectory import Trajectory, draw_trajectory
from ibrid.report.verdict import verdict
from ibrid.structure.diagram import Diagram

#: Operating points of a sweep that are drawn.
DRAWN = 6


def diagram_html(diagram: Diagram, kinds: Sequence[ModuleKind] = VOCABULARY) -> str:
    """A block diagram, drawn; kinds that are not in `kinds` get a box of their own colour."""
    words = f"{diagram.name}: {len(diagram.instances)} modules, {len(diagram.connections)} connections"
    return output([paragraph(words, "eyebrow"), diagrams_beside((("", diagram, ()),), kinds)])


def sweep_html(sweep: Sweep) -> str:
    """A table of the operating points, and the four admittances."""
    node = "at the filter capacitor" if sweep.power_node == "capacitor" else "at the terminals"
    words = f"{sweep.source or 'Sweep'}: {sweep.f0_hz:g} Hz, p and q {node}, per unit, current out of the inverter"
    names = ["operating point", "p", "q", "v", "frequencies", "from", "to", "noise", "amplitudes"]
    body = "".join(map(_point_row, sweep.points))
    listed = table("Operating points", "", head(names, (1, 2, 3, 4)) + f"<tbody>{body}</tbody>")
    points = sweep.points[:DRAWN]
    drawn = tuple(Curves(point.op.name, place, point, None, None) for place, point in enumerate(points))
    left = len(sweep.points) - len(points)
    note = [paragraph(f"{left} more operating points are not drawn.", "note")] if left else []
    return output([paragraph(words, "eyebrow"), listed, _bode(drawn, repr([one.op for one in points])), *note])


def record_html(record: Record) -> str:
    """The verdict, the response, and to unfold: errors, parameters, what the data cannot see, diagram, program."""
    diagram = readable(record.program)
    name = "" if diagram is None else diagram.name.removeprefix("build_")
    parts = [f"<header>{record_header(record, name or 'model')}</header>"]
    if record.reasons:
        parts.append(bullets(record.reasons))
    if record.parameters:
        measured, note = measured_data(record, None)
        parts += [paragraph(note, "note")] if note else []
        try:
            parts.append(_bode(curves(record, measured), record.program + repr(record.parameters)))
        except IbridError as problem:
            parts.append(paragraph(f"No model lines: {problem}", "bad"))
        parts.append(folded("Where the error lies", error_tables(record)))
        parts.append(folded("Parameters", parameter_html(record)))
        parts.append(folded("What the data can and cannot see", bullets(record.identifiability) + twins_table(record)))
    parts += [folded("Warnings", bullets(record.warnings))] if record.warnings else []
    if diagram is not None:
        parts.append(folded("Block diagram", diagrams_beside((("", diagram, ()),), record.vocabulary)))
    return output([*parts, folded("Program", program(record.program))])


def gap_html(gap: Gap) -> str:
    """The verdict, what is missing, errors before and after, and to unfold: the response, the changed program, the steps."""
    views = point_views(gap)
    parts = [f"<header>{gap_header(gap)}</header>", *(effect_html(gap, one) for one in gap.effects)]
    parts.append(summary_table(gap, views))
    worst = views[0]
    if worst.lines:
        legend = models_legend([(line.name, line.index) for line in worst.lines], worst.lines[-1].index)
        drawn = bode_figures(worst.curves, tag(gap.program + worst.name), f" at {worst.name}", zoom=False)
        parts.append(folded(f"Frequency response at {worst.name}", legend + drawn))
    parts.append(folded("What changed in the program", program_html(gap)))
    parts.append(folded("Block diagrams", diagrams_html(gap)))
    return output([*parts, folded("How it was decided", bullets(gap.steps))])


def search_html(
    folder: Path,
    best: Record | None,
    ending: str,
    evaluations: int,
    trajectory: Sequence[tuple[int, float | None, float | None]],
) -> str:
    """A search: how it went, its answer drawn, and where its page lies.

    trajectory : (evaluation, NRMSE or None, best so far or None). ending : why it ended.
    """
    facts = [("evaluations", str(evaluations)), ("ended since", escape(ending))]
    if best is not None and best.nrmse is not None:
        facts.append(("NRMSE found", data(best.nrmse, error(best.nrmse))))
        facts.append(("free parameters", str(best.free_parameters)))
    words = "No stable candidate was fitted." if best is None else verdict(best)
    parts = [f"<header>{page_header('Search', 'What was found', words, facts)}</header>"]
    if trajectory:
        parts.append(figure_html(_trajectory_svg(trajectory), "Error over the evaluations", style="medium"))
    if best is not None:
        diagram = readable(best.program)
        if diagram is not None:
            parts.append(diagrams_beside((("The answer", diagram, ()),), best.vocabulary))
        parts.append(folded("Parameters", parameter_html(best)))
        parts.append(folded("Program", program(best.program)))
    return output([*parts, paragraph(f"More in {folder / 'report.html'}", "note")])


# --- pieces ----------------------------------------------------------------------------------------------------------


def _bode(shown: Sequence[Curves], of: str) -> str:
    lines = any(one.model is not None for one in shown)
    words = "Lines: model. Dots: measured." if lines else "Dots: measured."
    names = ", ".join(one.name for one in shown)
    legend = points_legend([one.name for one in shown], lines=lines)
    return paragraph(words, "note") + legend + bode_figures(shown, tag(of + words), f" at {names}", zoom=False)


def _point_row(point: PointSweep) -> str:
    op, frequency = point.op, point.frequency
    noise = "not stated" if point.sigma is None else "known"
    if point.repeats is not None:
        noise = f"{len(point.repeats)} repeats"
    cells = [cell(number(value), numeric=True) for value in (op.p, op.q, op.v)]
    cells += [cell(str(len(frequency)), numeric=True), cell(hertz(frequency[0])), cell(hertz(frequency[-1]))]
    return row(op.name, [*cells, cell(noise), cell(str(1 + len(point.larger)))])


def _trajectory_svg(trajectory: Sequence[tuple[int, float | None, float | None]]) -> str:
    found = np.array([[np.nan if value is None else value for value in one] for one in trajectory], dtype=float)
    shown = Trajectory(found[:, 0], found[:, 1], np.ones(len(found), dtype=bool), found[:, 2])
    label = f"NRMSE of {len(found)} candidates, and the best so far, over the evaluations."
    name = tag(repr(trajectory))
    return inline_svg(lambda axes: draw_trajectory(axes, shown), name=name, label=label, size=(8.0, 3.4))
