"""How objects show themselves in notebooks: `_repr_html_` of diagrams, sweeps, records, gaps,
searches and analyses.

An output stands alone: its style reaches nothing else, it runs no script and loads nothing.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ibrid.analysis.grids.power_jacobian import PowerJacobian
from ibrid.analysis.grids.stability import Stability
from ibrid.analysis.models.linear_model import LinearModel
from ibrid.analysis.models.modes import QUANTILE
from ibrid.analysis.models.prediction import Prediction
from ibrid.analysis.models.residuals import Residuals
from ibrid.assembly.averaged import NonlinearModel
from ibrid.evaluation.record import Record
from ibrid.generic.answer import GenericAnswer
from ibrid.measurement.quality.event_inspection import EventsInspection
from ibrid.measurement.quality.inspect import Inspection
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.block_diagrams.block_diagram import Shown, drawn_diagrams, readable
from ibrid.report.facts.parameter_rows import parameter_groups, values_or_none
from ibrid.report.facts.verdict import graded, verdict
from ibrid.report.figures.bode import Curves, bode_svgs
from ibrid.report.figures.events import draw_events
from ibrid.report.figures.power_jacobian import draw_nfp
from ibrid.report.figures.residuals import draw_residuals
from ibrid.report.figures.trajectory import Trajectory, draw_trajectory
from ibrid.report.look.figure import inline_svg
from ibrid.report.pages.generic_page import generic_facts
from ibrid.report.pages.page import record_facts
from ibrid.report.pages.stability_page import mode_rows, stability_facts
from ibrid.report.pages.template import output, tag
from ibrid.structure.comparison.compare import Comparison, format_comparison
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.writing import aligned

#: Operating points of a sweep that are drawn.
DRAWN = 6


def diagram_html(diagram: Diagram, kinds: Sequence[ModuleKind] = VOCABULARY) -> str:
    """A block diagram, drawn; kinds that are not in `kinds` get a box of their own colour."""
    facts = {"diagram": diagram, "drawn": drawn_diagrams([Shown("", diagram)], kinds)}
    return output("diagram.html", facts, shown=("diagram",))


def sweep_html(sweep: Sweep) -> str:
    """A table of the operating points, and the four admittances."""
    points = sweep.points[:DRAWN]
    drawn = tuple(
        Curves(point.op.name, place, point, None, None) for place, point in enumerate(points)
    )
    name = tag(repr([point.op for point in points]))
    label = f" at {', '.join(line.name for line in drawn)}"
    facts = {
        "sweep": sweep,
        "drawn": [line.name for line in drawn],
        "bode": bode_svgs(drawn, name, label, zoom=False),
    }
    return output("sweep.html", facts, shown=("points", "response"))


def inspection_html(inspection: Inspection | EventsInspection) -> str:
    """The first look at a sweep or at records of events, as the command line prints it."""
    return _written("First look", str(inspection))


def comparison_html(comparison: Comparison) -> str:
    """What two diagrams have in common, as the command line prints it."""
    return _written("Comparison", format_comparison(comparison))


def model_html(model: LinearModel | NonlinearModel) -> str:
    """What a model is and where it rests: at its terminals, or in its states."""
    if isinstance(model, LinearModel):
        values = model.at_rest()
    else:
        values = dict(zip(model.states, model.x0.tolist(), strict=True))
    rows = [(name, f"{value:.6g}") for name, value in values.items()]
    return _written(repr(model).strip("<>"), aligned(rows))


def jacobian_html(jacobian: PowerJacobian) -> str:
    """The NFP, drawn."""
    svg = inline_svg(
        lambda axes: draw_nfp(axes, jacobian),
        name=tag(repr(jacobian.plain())),
        label=f"Power over the frequency of the grid at {jacobian.op}.",
        size=(8.0, 4.6),
        rows=2,
    )
    return _written(repr(jacobian).strip("<>"), "", svg)


def residuals_html(residuals: Residuals) -> str:
    """Residuals over frequency, drawn, and whether they are white."""
    svg = inline_svg(
        lambda axes: draw_residuals(axes[0], residuals),
        name=tag(repr(residuals.autocorrelation.tolist())),
        label="Standardised residuals over frequency.",
        size=(8.0, 3.4),
    )
    return _written("Residuals", repr(residuals).strip("<>"), svg)


def _written(eyebrow: str, text: str, svg: str = "") -> str:
    return output("inspection.html", {"eyebrow": eyebrow, "text": text, "svg": svg}, shown=())


def events_html(events: Events) -> str:
    """Voltages and currents of every record, drawn."""
    svg = inline_svg(
        lambda axes: draw_events(axes, events),
        name=tag(repr(events) + repr(events.source)),
        label=f"Voltage and current of {', '.join(events.names)}.",
        size=(8.0, 4.6),
        rows=2,
    )
    return output("events.html", {"events": events, "svg": svg}, shown=())


def record_html(record: Record) -> str:
    """The verdict, the response, and to unfold: errors, parameters, what the data cannot see,
    diagram, program.
    """
    facts = record_facts(record, None, tag(record.program + repr(record.parameters)), zoom=False)
    return output("record.html", facts, shown=("reasons", "response"))


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
    diagram = None if best is None else readable(best.program)
    facts = {
        "page": folder / "report.html",
        "best": best,
        "verdict": "" if best is None else verdict(best),
        "grade": None if best is None else graded(best),
        "ending": ending,
        "evaluations": evaluations,
        "trajectory": _trajectory_svg(trajectory) if trajectory else "",
        "drawn": best
        and diagram
        and drawn_diagrams(
            [Shown("The answer", diagram, values=values_or_none(best))], best.vocabulary
        ),
        "parameters": best and parameter_groups(best),
    }
    return output("searched.html", facts, shown=("trajectory", "diagram", "more"))


def generic_html(answer: GenericAnswer) -> str:
    """Errors by record, remarks and the parameters."""
    facts = generic_facts(answer) | {"figures": []}
    return output("generic.html", facts, shown=("errors", "parameters"))


def prediction_html(point: Prediction) -> str:
    """Whether it is stable, how wide the bands are, warnings, the four admittances with bands; to
    unfold: the modes.
    """
    half_width = None if point.sigma is None else QUANTILE * point.sigma
    line = Curves(point.op.name, 0, None, point.frequency, point.admittance, half_width)
    widest = None
    if (band := point.relative_band) is not None:
        widest = (float(band.max()), float(point.frequency[int(band.argmax())]))
    facts = {
        "point": point,
        "widest": widest,
        "bode": bode_svgs(
            [line], tag(repr((point.op, point.A.tolist()))), f" at {point.op.name}", zoom=False
        ),
        "modes": mode_rows(point.modes),
    }
    return output("prediction.html", facts, shown=("response",))


def stability_html(study: Stability) -> str:
    """The answer in sentences, the table over the grids; to unfold: root locus, eigenloci,
    passivity, modes.
    """
    facts = stability_facts(study, f"{tag(repr(study.plain()))}-", zoom=False)
    return output(
        "stability.html",
        facts | {"above": "Identified inverter", "source": ""},
        shown=("critical", "grids"),
    )


def _trajectory_svg(trajectory: Sequence[tuple[int, float | None, float | None]]) -> str:
    found = np.array(trajectory, dtype=float)  # None becomes nan
    shown = Trajectory(found[:, 0], found[:, 1], np.ones(len(found), dtype=bool), found[:, 2])
    label = f"NRMSE of {len(found)} candidates, and the best so far, over the evaluations."
    name = tag(repr(trajectory))
    return inline_svg(
        lambda axes: draw_trajectory(axes, shown), name=name, label=label, size=(8.0, 3.4)
    )
