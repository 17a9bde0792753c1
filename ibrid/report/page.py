"""One self-contained HTML page about a record: no network, complete without scripts, readable on paper and telephones."""

from collections.abc import Iterator
from pathlib import Path

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.sweep import Sweep
from ibrid.report.bode import Curves, bode_figures, curves
from ibrid.report.diagrams_beside import diagrams_beside
from ibrid.report.error_table import error_tables
from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.legend import points_legend
from ibrid.report.markup import (
    Section,
    bullets,
    data,
    judged,
    page,
    page_header,
    paragraph,
    program,
    stable_or_not,
    table,
)
from ibrid.report.measured_data import measured_data
from ibrid.report.numbers import error
from ibrid.report.parameter_table import parameter_html, twins_table
from ibrid.report.pole_table import pole_tables
from ibrid.report.poles import draw_poles
from ibrid.report.settings_table import settings_rows
from ibrid.report.verdict import stability, verdict
from ibrid.structure.diagram import Diagram
from ibrid.writing import write_whole


def write_report(record: Record, path: str | Path, *, sweep: Sweep | None = None, title: str | None = None) -> Path:
    """Write the page of a record, replacing the file atomically.

    Parameters
    ----------
    record : of any outcome; one without a fit gives the reasons, the program and, where it parses, its diagram.
    sweep : the measured data; read again from where the record says when not given. Without data only model lines.
    title : headline; the name of the program when not given.

    Returns the path. Raises IbridError when it cannot be written.
    """
    path = Path(path)
    write_whole(path, report_html(record, sweep=sweep, title=title))
    return path


def report_html(record: Record, *, sweep: Sweep | None = None, title: str | None = None) -> str:
    """The page as text."""
    diagram = _diagram(record)
    headline = title or (diagram.name.removeprefix("build_") if diagram is not None else "") or "model"
    measured, note = measured_data(record, sweep) if record.parameters else (None, "")
    sections = list(_sections(record, measured, note, diagram))
    words = f"Fitted in {record.seconds:.2f} s."
    return page(f"{headline}: {record.outcome}", record_header(record, headline), sections, words)


def _diagram(record: Record) -> Diagram | None:
    try:
        return record.diagram
    except IbridError:
        return None


def record_header(record: Record, headline: str) -> str:
    """What the page of a record begins with."""
    source = str(record.settings.get("data") or "")
    facts = [("outcome", judged(record.outcome == "ok", str(record.outcome)))]
    if record.nrmse is not None:
        facts.append(("NRMSE, mean over points", data(record.nrmse, error(record.nrmse))))
        facts.append(("stability", stable_or_not(bool(record.stable) and all(record.stable.values()))))
        facts.append(("order", str(record.order)))
        facts.append(("free parameters", str(record.free_parameters)))
    if record.modules:
        facts.append(("modules and sums", f"{record.modules} + {record.sums}"))
    above = "Identified inverter model" + (f" against {source}" if source else "")
    return page_header(above, headline, verdict(record), facts)


def _sections(record: Record, measured: Sweep | None, note: str, diagram: Diagram | None) -> Iterator[Section]:
    if record.reasons:
        yield "reasons", "Why there is no fit", bullets(record.reasons)
    if record.parameters:
        yield "response", "Frequency response", _response(record, measured, note)
        yield "error", "Where the error lies", error_tables(record)
        yield "poles", "Poles and stability", _poles(record)
        yield "parameters", "Parameters", parameter_html(record)
        yield "visible", "What the data can and cannot see", _visible(record)
    if record.warnings:
        yield "warnings", "Warnings", bullets(record.warnings)
    yield "diagram", "Block diagram", _drawing(record, diagram)
    yield "settings", "How it was made", table("Settings", "Enough to make the record again.", settings_rows(record))
    yield "program", "Program", program(record.program)


def _response(record: Record, measured: Sweep | None, note: str) -> str:
    notes = [note] if note else []
    try:
        shown = curves(record, measured)
    except IbridError as problem:
        notes.append(f"No model lines: {problem}")
        shown = curves(record, measured, with_model=False)
    words = "Lines: model." if measured is None else "Dots: measured. Lines: model."
    if any(one.measured is not None and one.measured.sigma is not None for one in shown):
        words += " Bars: two standard deviations."
    return (
        "".join(paragraph(one, "bad") for one in notes)
        + paragraph(f"{words} Admittance per unit, current out of the inverter.", "note")
        + points_legend([one.name for one in shown], lines=True)
        + bode_figures(shown, "bode", f", magnitude and phase over frequency, at {_names(shown)}.")
    )


def _names(shown: tuple[Curves, ...]) -> str:
    return ", ".join(one.name for one in shown)


def _poles(record: Record) -> str:
    label = "Poles in the upper half plane, real part against frequency; the table below gives the least damped modes."
    svg = inline_svg(lambda axes: draw_poles(axes, record), name="poles", label=label, size=(5.2, 3.8))
    caption = (
        "Upper half plane; scales are logarithmic away from zero. Dashed: constant damping ratio. Shaded: unstable."
    )
    return (
        paragraph(f"The model on an ideal grid is {stability(record)}.")
        + points_legend(list(record.poles), lines=False)
        + f'<div class="beside">{figure_html(svg, words=caption)}<div>{pole_tables(record)}</div></div>'
    )


def _visible(record: Record) -> str:
    if not record.identifiability:
        return "<p>The record says nothing about what the data can see.</p>"
    return bullets(record.identifiability) + twins_table(record)


def _drawing(record: Record, diagram: Diagram | None) -> str:
    if diagram is None:
        return "<p>The program cannot be read, so there is no diagram to draw.</p>"
    return diagrams_beside((("", diagram, ()),), record.vocabulary)
