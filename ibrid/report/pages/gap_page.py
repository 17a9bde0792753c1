"""report.html of a gap: one self-contained page, the verdict on top, before and after, where, what,
and what is open.
"""

from collections.abc import Sequence
from typing import Any

from ibrid.gap.results.gap import Gap, NamedEffect, ParameterChange
from ibrid.gap.results.verdict import FAR
from ibrid.gap.workflow import FEWEST
from ibrid.measurement.quality.sequence_view import sequence_view
from ibrid.measurement.sweeps.sweep import ENTRIES
from ibrid.report.block_diagrams.block_diagram import Shown, drawn_diagrams, readable
from ibrid.report.facts.gap_words import (
    HELD_OUT,
    change_words,
    declared,
    evidence_words,
    far,
    headline,
    moved_interval,
    of_forms_alone,
    parameter_words,
)
from ibrid.report.facts.left_over import left_by_gap
from ibrid.report.facts.parameter_rows import parameter_groups, values_or_none
from ibrid.report.facts.verdict import stability
from ibrid.report.figures.bode import bode_svgs
from ibrid.report.figures.gap_curves import (
    PointView,
    comparable,
    draw_entry,
    errors_by_part,
    errors_by_point,
    point_views,
    repaired,
)
from ibrid.report.figures.gap_ports import (
    PORTS,
    draw_gain,
    draw_missing,
    draw_ports,
    room_for_names,
)
from ibrid.report.look.figure import inline_svg, inline_svgs
from ibrid.report.pages.playback_page import record_svg
from ibrid.report.pages.template import output, page, tag
from ibrid.structure.comparison.compare import difference
from ibrid.structure.diagrams.diagram import Diagram

#: Operating points that get figures.
POINTS = 6
#: Unchanged lines of a program that are shown on each side of a change.
AROUND = 2


def gap_page(gap: Gap) -> str:
    """The page as text."""
    if gap.events is not None and not gap.events.swept:
        facts = {"moved": _moved(gap), "far_limit": FAR, "records": _records(gap)}
        return page("gap_events.html", _said(gap) | facts)
    views = point_views(gap)
    responses = [(view, _entries(view, place)) for place, view in enumerate(views[:POINTS])]
    figures = {
        "views": views,
        "responses": responses,
        "not_drawn": [view.name for view in views[POINTS:]],
        "models": list(
            dict.fromkeys((line.name, line.index) for view in views for line in view.lines)
        ),
        "ports_svg": _ports(gap),
        "transfer": _transfer(gap),
        "amplitude": _amplitude(gap),
        "records": _records(gap),
    }
    best = next((edit for edit in gap.suggested if not edit.reason), None)  # that passes every test
    details = {
        "sequences": sequence_view(gap.sweep).sentences,
        "stability": stability(gap.repaired),
        "left": left_by_gap(gap),
        "error_parts": errors_by_part(views),
        "best": best,
        "best_change": () if best is None else difference(gap.given, best.program, AROUND),
        "held_out_words": HELD_OUT,
        "moved": _moved(gap),
        "far_limit": FAR,
        "parameters": parameter_groups(gap.repaired),
    }
    return page("gap.html", _facts(gap, views) | details | figures)


def _said(gap: Gap) -> dict[str, Any]:
    """The verdict and the effects."""
    return {
        "gap": gap,
        "headline": headline(gap),
        "form_alone": of_forms_alone(gap),
        "repaired": repaired(gap),
        "grade": gap.repaired.grade,
        "far": len(far(gap)),
        "effects": [_effect(gap, effect) for effect in gap.effects],
        "changed": difference(gap.given, gap.program, AROUND),
    }


def _records(gap: Gap) -> list[tuple[str, float | None, float | None, str]]:
    """Each record with its errors before and after, and its figure."""
    if gap.events is None:
        return []
    rows, values = [], gap.events.after.model.values
    pairs = zip(gap.events.before.records, gap.events.after.records, strict=True)
    for number, (before, after) in enumerate(list(pairs)[:POINTS]):
        lines = {"refitted": before.current} | (
            {"repaired": after.current} if repaired(gap) else {}
        )
        svg = record_svg(f"record-{number}", after, lines, values)
        rows.append((before.record.name, before.nrmse, after.nrmse if repaired(gap) else None, svg))
    return rows


def _moved(gap: Gap) -> list[tuple[ParameterChange, float | None, str]]:
    before = next(iter(gap.baseline.parameters.values()), {}) if repaired(gap) else {}
    return [
        (parameter, before.get(parameter.name), moved_interval(parameter))
        for parameter in gap.moved
    ]


def gap_html(gap: Gap) -> str:
    """For a notebook: the verdict, what is missing, errors before and after, and to unfold:
    response, program, steps.
    """
    views = point_views(gap)
    worst = views[0]
    figures = {
        "views": views,
        "responses": [
            (
                worst,
                bode_svgs(
                    worst.curves, tag(gap.program + worst.name), f" at {worst.name}", zoom=False
                ),
            )
        ],
        "models": [(line.name, line.index) for line in worst.lines],
    }
    return output("gap.html", _facts(gap, views) | figures, shown=("missing", "error"))


def _facts(gap: Gap, views: Sequence[PointView]) -> dict[str, Any]:
    """What the page and the notebook share; in each of two drawings what the other lacks is
    framed.
    """
    given, after = readable(gap.given), readable(gap.program)
    drawn = given_drawn = None
    lost, new = (), ()
    if given is not None and after is not None:
        changed, kinds = gap.given != gap.program, gap.repaired.vocabulary
        lost, new = _only_in(given, after), _only_in(after, given)
        shown = Shown("", after, new, values_or_none(gap.repaired)) if changed else Shown("", given)
        drawn = drawn_diagrams([shown], kinds)
        given_drawn = drawn_diagrams([Shown("", given, lost)], kinds) if changed else None
    return _said(gap) | {
        "worst": views[0],
        "comparable": comparable(gap),
        "summary": errors_by_point(gap, views),
        "drawn": drawn,
        "given_drawn": given_drawn,
        "framed": bool(lost or new),
    }


def _effect(gap: Gap, effect: NamedEffect) -> dict[str, Any]:
    rivals = (effect.id, *effect.indistinguishable_from)
    return {
        "effect": effect,
        "words": change_words(effect),
        "declared": declared(effect.id),
        "parameters": list(parameter_words(gap, effect)),
        "apart": [(name, known.told_apart_by) for name in rivals if (known := declared(name))],
        "evidence": list(evidence_words(effect.evidence)),
    }


# --- figures
# ----------------------------------------------------------------------------------------------


def _only_in(diagram: Diagram, other: Diagram) -> tuple[str, ...]:
    """Names of modules that another diagram lacks, or has of another kind or with other
    bindings.
    """
    there = {instance.name: instance for instance in other.instances}
    return tuple(
        instance.name for instance in diagram.instances if there.get(instance.name) != instance
    )


def _entries(view: PointView, place: int) -> dict[str, Any]:
    models = ", ".join(line.name for line in view.lines)
    what = (
        "magnitude, phase, and distance from the measurement over frequency. The tables give the "
        "errors."
    )
    drawings = {
        f"gap-{place}-{entry}": (
            f"Y_{entry} at {view.name}: measured, {models}; {what}",
            lambda axes, entry=entry: draw_entry(axes, entry, view),
        )
        for entry in ENTRIES
    }
    svgs = inline_svgs(drawings, size=(5.2, 5.0), rows=3, heights=(1.25, 0.95, 0.95), zoom=True)
    return dict(zip(ENTRIES, svgs, strict=True))


def _ports(gap: Gap) -> str:
    if (
        not gap.ports or gap.verdict == "data-convention"
    ):  # a place in the device explains no convention
        return ""
    return inline_svg(
        lambda axes: draw_ports(axes, gap.ports),
        name="ports",
        label="chi2 per degree of freedom of every port on a logarithmic scale; the table gives "
        "the numbers.",
        size=(7.4, 0.9 + 0.36 * min(len(gap.ports), PORTS)),
        left=room_for_names(gap.ports),
    )


def _transfer(gap: Gap) -> dict[str, Any] | None:
    transfer = gap.missing_transfer
    if transfer is None or not gap.ports:
        return None
    line = "." if transfer.line is None else ", and the curve of the named block."
    svg = inline_svg(
        lambda axes: draw_missing(axes, transfer),
        name="transfer",
        label=f"Measured transfer at {transfer.fit.port.words}, magnitude and phase with error "
        f"bars{line}",
        size=(7.4, 4.6),
        rows=2,
        zoom=True,
    )
    return {"found": transfer, "svg": svg, "hidden": int((~transfer.seen).sum())}


def _amplitude(gap: Gap) -> dict[str, Any]:
    answer = gap.amplitude
    if answer is None or (gain := answer.port_gain) is None:
        return {"fewest": FEWEST, "svg": ""}
    svg = inline_svg(
        lambda axes: draw_gain(axes, gain, answer.linearity.amplitudes),
        name="port-gain",
        label=f"Measured gain of {answer.words} against the amplitude at its port, real and "
        "imaginary part, and the "
        "describing function.",
        size=(7.4, 4.6),
        rows=2,
        heights=(2.2, 1.0),
    )
    return {"fewest": FEWEST, "svg": svg}
