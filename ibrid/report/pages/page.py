"""One self-contained HTML page about a record: no network, complete without scripts, readable on
paper and telephones.
"""

from collections.abc import Mapping
from os.path import isfile
from pathlib import Path
from typing import Any

from ibrid.analysis.models.loop_modes import loops_told
from ibrid.border import takes_kinds
from ibrid.errors import IbridError
from ibrid.evaluation.errors_by_part import nrmse
from ibrid.evaluation.record import Record
from ibrid.foreign_text import place_shown
from ibrid.measurement.quality.sequence_view import sequence_view
from ibrid.measurement.read import read_sweep
from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.recordings.fixed_steps import in_fixed_steps
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.playback.compare import model_of_record, play
from ibrid.report.block_diagrams.block_diagram import Shown, drawn_diagrams, readable
from ibrid.report.facts.bases import admittance_base
from ibrid.report.facts.left_over import left_by_record
from ibrid.report.facts.modes import draw_poles, measured_up_to, modes, slowest
from ibrid.report.facts.parameter_rows import parameter_groups, twin_rows, values_or_none
from ibrid.report.facts.verdict import graded, stability, verdict, work_of
from ibrid.report.figures.bode import bode_svgs, curves, impedance_svgs
from ibrid.report.look.figure import inline_svg
from ibrid.report.pages.playback_page import facts_of_record, validation_facts
from ibrid.report.pages.template import page
from ibrid.writing import write_whole

#: Modes that are listed for each operating point.
LISTED = 5


@takes_kinds
def write_report(
    record: Record,
    path: str | Path,
    *,
    sweep: Sweep | None = None,
    events: Events | None = None,
    title: str | None = None,
) -> Path:
    """Write the page of a record, replacing the file atomically.

    Parameters
    ----------
    record : of any outcome; one without a fit gives the reasons, the program and, where it parses,
    its diagram.
    sweep : the measured data; read again from where the record says when not given. Without data
    only model lines.
    events : the records that it was fitted to, which are then played and drawn.
    title : headline; the name of the program when not given.

    Returns the path. Raises IbridError when it cannot be written.
    """
    path = Path(path)
    write_whole(path, report_html(record, sweep=sweep, events=events, title=title))
    return path


def report_html(
    record: Record,
    *,
    sweep: Sweep | None = None,
    events: Events | None = None,
    title: str | None = None,
) -> str:
    """The page as text."""
    facts = record_facts(record, sweep, "bode", title=title) | {
        "events": facts_of_record(record, events)
    }
    facts |= validation_facts(record.validation)
    return page("record.html", facts | (_pole_facts(record) if record.parameters else {}))


def record_facts(
    record: Record, sweep: Sweep | None, name: str, *, title: str | None = None, zoom: bool = True
) -> dict[str, Any]:
    """What record.html is filled with, but for the poles.

    `name` : of the figures; `zoom` : False where no script runs.
    """
    diagram = readable(record.program)
    return {
        "record": record,
        "work": work_of(record),
        "events": None,
        "headline": title
        or (diagram.name.removeprefix("build_") if diagram is not None else "")
        or "model",
        "source": str(record.settings.get("data") or ""),
        "verdict": verdict(record),
        "grade": graded(record),
        "drawn": None
        if diagram is None
        else drawn_diagrams([Shown("", diagram, values=values_or_none(record))], record.vocabulary),
        "loops": loops_told(record),
        "left": left_by_record(record),
        "parameters": parameter_groups(record),
        "twins": twin_rows(record),
        "settings": [
            *((name, plain_words(value)) for name, value in record.settings.items()),
            *((f"starts: {name}", plain_words(value)) for name, value in record.starts.items()),
        ],
    } | (_response_facts(record, sweep, name, zoom) if record.parameters else {})


def _response_facts(record: Record, sweep: Sweep | None, name: str, zoom: bool) -> dict[str, Any]:
    measured, doubt = measured_data(record, sweep)
    doubts = [doubt] if doubt else []
    try:
        shown = curves(record, measured)
    except IbridError as problem:
        doubts.append(f"No model lines: {problem}")
        shown = curves(record, measured, with_model=False)
    names = [line.name for line in shown]
    label = f", magnitude and phase over frequency, at {', '.join(names)}."
    return {
        "doubts": doubts,
        "measured": measured is not None,
        "bars": any(
            line.measured is not None and line.measured.sigma is not None for line in shown
        ),
        "points": names,
        "bode": bode_svgs(shown, name, label, zoom=zoom),
        "impedance": impedance_svgs(shown, f"{name}-z", label) if zoom else None,
        "y_base": admittance_base(record),
        "sequences": () if measured is None else sequence_view(measured).sentences,
    }


def _pole_facts(record: Record) -> dict[str, Any]:
    label = (
        "Poles in the upper half plane, real part against frequency; the table below gives the "
        "least damped modes."
    )
    highest = measured_up_to(record)
    orders = record.settings.get("pade_orders") or {}
    return {
        "stability": stability(record),
        "slowest": {op: slowest(poles) for op, poles in record.poles.items()},
        "modes": {op: modes(poles, highest)[:LISTED] for op, poles in record.poles.items()},
        "listed": LISTED,
        "highest": highest,
        "pade": "; ".join(f"{name} of order {order}" for name, order in orders.items()),
        "poles_svg": inline_svg(
            lambda axes: draw_poles(axes, record), name="poles", label=label, size=(5.2, 3.8)
        ),
    }


def plain_words(value: Any) -> str:
    """A setting as text."""
    if isinstance(value, Mapping):
        return "; ".join(f"{name}: {plain_words(inner)}" for name, inner in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(plain_words, value)) or "none"
    if isinstance(value, float):
        return f"{value:g}"
    return "none" if value is None else str(value)


#: Relative difference of an NRMSE above which the data are not those of the record.
SAME = 1e-3
#: Differences of NRMSE below this are rounding.
ROUNDING = 1e-9


def measured_data(record: Record, sweep: Sweep | None) -> tuple[Sweep | None, str]:
    """The sweep to show, if there is one, and a sentence about it, "" when all is as it should
    be.
    """
    if sweep is None and record.nrmse_by_record and not record.nrmse_by_part:
        return None, ""  # records of events alone: nothing was swept
    if sweep is None:
        path = place_shown(str(record.settings.get("data") or ""))
        if not isfile(path):  # unlike a Path it bears any text
            missing = (
                f"the data file {path} is not there"
                if path
                else "the record does not say where its data are"
            )
            return (
                None,
                f"Only model lines are shown: {missing}; give the sweep to show the measured dots.",
            )
        try:
            sweep = read_sweep(path)
        except IbridError as problem:
            return None, f"Only model lines are shown: the data cannot be read again ({problem})"
    return sweep, _doubt(record, sweep)


def measured_events(record: Record, events: Events | None) -> tuple[Events | None, str]:
    """The records to play and show, if it was fitted to any, and a sentence about them, "" when all
    is as it should be.
    """
    if not record.nrmse_by_record:
        return (
            None,
            ""
            if events is None
            else "The record was not fitted to records of events; they are left out.",
        )
    if events is None:
        path = place_shown(str(record.settings.get("events") or ""))
        if not isfile(path):
            return (
                None,
                f"Records of events are not shown: the file {path or 'of them'} is not there; give "
                "it.",
            )
        try:
            events = read_events(path)
        except IbridError as problem:
            return None, f"Records of events are not shown: they cannot be read again ({problem})"
    if record.settings.get("events_solver"):  # found out by a gap: the file need not say it
        events = in_fixed_steps(events)
    missing = [name for name in record.nrmse_by_record if name not in events.names]
    if missing:
        return None, f"Records of events are not shown: {events.source} lacks {', '.join(missing)}."
    events = events.only(*record.nrmse_by_record)
    for played in play(model_of_record(record), events).records:
        stated = record.nrmse_by_record[played.record.name]
        if played.nrmse is None or abs(played.nrmse - stated) > SAME * stated + ROUNDING:
            return events, (
                f"The records shown are not those that were fitted: {played.record.name} has an "
                "NRMSE of "
                f"{played.nrmse or float('nan'):.3g}, the record states {stated:.3g}."
            )
    return events, ""


def _doubt(record: Record, sweep: Sweep) -> str:
    """Whether the sweep gives the errors that the record states."""
    missing = [name for name in record.parameters if name not in sweep.names]
    if missing:
        return (
            f"The data shown lack the operating points {', '.join(missing)}; they may have changed "
            "since the fit."
        )
    for name, stated in {**record.nrmse_by_op, **record.holdout}.items():
        try:
            point = sweep.point(name)
            actual = nrmse(record.response(name, point.frequency), point)
        except IbridError:
            return ""
        if abs(actual - stated) > SAME * stated + ROUNDING:
            return (
                f"The dots are not those that were fitted: at {name} they give an NRMSE of "
                f"{actual:.3g}, the record "
                f"states {stated:.3g}; the file has changed, or was read with other options."
            )
    return ""
