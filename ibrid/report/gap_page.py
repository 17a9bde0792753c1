"""report.html of a gap: one self-contained page, the verdict on top, before and after, where, what, and what is open."""

from collections.abc import Iterator, Sequence

from ibrid.gap.result import Gap
from ibrid.gap.verdict import FAR
from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.gap_amplitude import amplitude_html
from ibrid.report.gap_curves import PointView, point_views, repaired
from ibrid.report.gap_errors import part_table, summary_table
from ibrid.report.gap_measured import missing
from ibrid.report.gap_ports import PORTS, draw_missing, draw_ports, room_for_names
from ibrid.report.gap_program import diagrams_html, program_html
from ibrid.report.gap_response import responses_html
from ibrid.report.gap_suggestions import suggestions_html
from ibrid.report.gap_tables import (
    candidate_table,
    effect_html,
    located_table,
    moved_table,
    port_table,
    unseen_table,
)
from ibrid.report.gap_words import UNKNOWN, far, headline, next_step
from ibrid.report.markup import Section, bullets, data, escape, folded, numbered, page, page_header, paragraph
from ibrid.report.numbers import error
from ibrid.report.parameter_table import parameter_html
from ibrid.report.verdict import stability

#: Verdicts after which nothing is wrong, and those that leave a question.
FINE, OPEN = ("no-gap", "parameters-only"), ("located-unnamed", "unexplained")


def gap_page(gap: Gap) -> str:
    """The page as text."""
    views = point_views(gap)
    return page(f"Gap: {headline(gap)}", gap_header(gap), _sections(gap, views))


def gap_header(gap: Gap) -> str:
    """What the page of a gap begins with."""
    style = "good" if gap.verdict in FINE else "bad" if gap.verdict in OPEN else ""
    facts = [("verdict", f'<span class="{style}">{escape(gap.verdict)}</span>')]
    facts.append(("NRMSE, refitted", _error(gap.before.get("refit"))))
    if repaired(gap):
        facts.append(("NRMSE, repaired", _error(gap.after.get("refit"))))
    elif gap.amplitude is not None and gap.amplitude.after is not None:
        facts.append(("NRMSE, with the effect", _error(gap.amplitude.after)))
    if gap.held_out:
        words = _error(gap.before.get("holdout"))
        facts.append(("held out", f"{words} → {_error(gap.after.get('holdout'))}" if repaired(gap) else words))
    facts.append(("noise alone", UNKNOWN if gap.noise_floor is None else _error(gap.noise_floor)))
    facts.append(("parameters far off", str(len(far(gap)))))
    source = f": {gap.sweep.source}" if gap.sweep.source else ""
    return page_header(f"Simulation against measurement{source}", headline(gap), gap.sentence, facts)


def _error(value: float | None) -> str:
    return data(value, error(value))


def _sections(gap: Gap, views: Sequence[PointView]) -> Iterator[Section]:
    yield "missing", "What is missing" if gap.verdict == "named" else "What it means", _missing(gap)
    if gap.amplitude is not None:
        yield "amplitude", "How the response depends on the amplitude", amplitude_html(gap.amplitude)
    yield "error", "Before and after", summary_table(gap, views) + part_table(views)
    yield "response", "Frequency response", responses_html(gap, views)
    yield "located", "Where the refitted model misses the data", located_table(gap)
    if gap.ports and gap.verdict != "data-convention":  # a place in the device explains no convention
        yield "ports", "Which place explains it", _ports(gap)
    if gap.suggested:
        yield "suggested", "What it might be", suggestions_html(gap)
    yield "moved", "What moved", _moved(gap)
    yield "candidates", "What else was tried", candidate_table(gap)
    yield "unseen", "What this experiment could not have seen", unseen_table(gap)
    yield "program", "What changed in the program", program_html(gap)
    yield "diagram", "Block diagrams", diagrams_html(gap)
    yield "steps", "How it was decided", _steps(gap)


def _missing(gap: Gap) -> str:
    words = [step] if (step := next_step(gap)) else []
    if repaired(gap):
        words.append(f"The repaired model is {stability(gap.repaired)}.")
    return "".join(map(paragraph, words)) + "".join(effect_html(gap, one) for one in gap.effects)


# --- ports -----------------------------------------------------------------------------------------------------------


def _ports(gap: Gap) -> str:
    count = min(len(gap.ports), PORTS)
    svg = inline_svg(
        lambda axes: draw_ports(axes, gap.ports),
        name="ports",
        label="chi2 per degree of freedom of every port on a logarithmic scale; the table gives the numbers.",
        size=(7.4, 0.9 + 0.36 * count),
        left=room_for_names(gap.ports),
    )
    words = (
        "One unknown complex number per frequency, the same at all operating points, at one place of the given model, fitted "
        "together with the parameters. Hatched: it explains all; left of the dashed line a fit is adequate."
    )
    table = folded("All numbers", port_table(gap))
    return paragraph(words, "note") + figure_html(svg, style="medium") + table + _transfer(gap)


def _transfer(gap: Gap) -> str:
    found = missing(gap)
    if found is None:
        return ""
    where = found.fit.port.words
    svg = inline_svg(
        lambda axes: draw_missing(axes, found),
        name="transfer",
        label=f"Measured transfer at {where}, magnitude and phase with error bars"
        + (", and the curve of the named block." if found.line is not None else "."),
        size=(7.4, 4.6),
        rows=2,
        zoom=True,
    )
    place = "in place of a plain wire" if found.series else "beside what the model has"
    words = f"Dots: what the measurement says must act there {place}, at each frequency by itself"
    if found.line is not None:
        words += ", the parameters being those of the repaired model. Line: the block that the repair put there."
    else:
        words += ", the parameters being those of the fit at this place."
    words += " Bars: two standard deviations."
    hidden = int((~found.seen).sum())
    if hidden:
        words += f" {hidden} of {found.seen.size} frequencies say nothing about this place and are left out."
    title = f"<h3>The missing transfer, measured at: {escape(where)}</h3>"
    return title + paragraph(words, "note") + figure_html(svg, style="medium")


# --- parameters and steps --------------------------------------------------------------------------------------------


def _moved(gap: Gap) -> str:
    shown = moved_table(gap)
    if gap.null_space:
        shown += "<h3>What the data cannot tell</h3>" + bullets(gap.null_space)
    words = "All parameters of the repaired model" if repaired(gap) else "All parameters of the refitted model"
    whole = parameter_html(gap.repaired)
    return shown + folded(words, whole)


def _steps(gap: Gap) -> str:
    words = [f"Noise: {gap.noise}.", f"Moved far: beyond {FAR:g} standard deviations of the tolerance."]
    if gap.seconds:
        words.append(f"It took {gap.seconds:.0f} s.")
    return numbered(gap.steps) + paragraph(" ".join(words), "note")
