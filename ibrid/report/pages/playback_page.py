"""The page of a playback: for each record v, i_d, i_q, p and q, measured and modelled, the window
of the event shaded.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ibrid.evaluation.record import Record
from ibrid.measurement.recordings.event_windows import WINDOWS
from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.playback.compare import Playback, PlayedRecord, model_of_record, play
from ibrid.report.facts.step_rows import STEP_HEAD, step_rows
from ibrid.report.facts.validation_rows import rows_of, validation_sentence
from ibrid.report.look.figure import inline_svg
from ibrid.report.look.style import INK, MUTED, Axes, series
from ibrid.report.pages.template import page

#: Records that get figures.
DRAWN = 8
#: Windows that are shaded: while the voltage is away.
SHADED = ("first cycle", "during")
#: Part of what a curve spans by which a level may lie beyond it to be drawn.
NEAR = 0.2
#: Numbers of limits that are levels of curves: the curves, and the levels.
LEVELS = {
    "current_limit.i_max": (("i_d", "i_q"), lambda i_max: (-i_max, i_max)),
    "pll_freeze.v_freeze": (("|v|",), lambda v: (v,)),
    "momentary_cessation.v_block": (("|v|",), lambda v: (v,)),
    "voltage_support.dead": (("|v|",), lambda dead: (1 - dead, 1 + dead)),
}


def playback_page(
    playback: Playback,
    title: str,
    validation: Mapping[str, Any] | None = None,
    steps: Mapping[str, Any] | None = None,
) -> str:
    """The page as text.

    title : what was played. validation : measures of a standard, which were asked for. steps :
    record -> how a set point is followed.
    """
    facts = {
        "playback": playback,
        "above": title,
        "steps": step_rows(steps or {}),
        "step_head": STEP_HEAD,
    }
    facts |= played_facts(playback)
    return page("playback.html", facts | validation_facts(validation))


def validation_facts(validation: Mapping[str, Any] | None) -> dict[str, Any]:
    """The measures of a standard, for any page; empty rows without any."""
    if not validation:
        return {"validated": [], "validated_words": ""}
    return {"validated": [*rows_of(validation)], "validated_words": validation_sentence(validation)}


def played_facts(playback: Playback) -> dict[str, Any]:
    """Errors by record and window, and the figures, for any page."""
    rows = [(one, [one.by_window.get(name) for name in WINDOWS]) for one in playback.records]
    figures = [
        (
            one.record.name,
            record_svg(f"record-{k}", one, {"model": one.current}, playback.model.values),
        )
        for k, one in enumerate(playback.records[:DRAWN])
    ]
    return {"rows": rows, "windows": WINDOWS, "figures": figures}


def facts_of_record(record: Record | None, events: Events | None) -> dict[str, Any] | None:
    """The same of a record that was fitted to events; None where it was not, or where they are
    gone.
    """
    if record is None or events is None or not record.nrmse_by_record:
        return None
    return played_facts(play(model_of_record(record), events))


def record_svg(
    name: str, played: PlayedRecord, lines: Mapping[str, np.ndarray], values: Mapping[str, float]
) -> Any:
    """Five curves of a record over time.

    lines : what each current (N, 2) is called. values : of the model, limits among them.
    """
    record = played.record
    return inline_svg(
        lambda axes: _draw(axes, record, played.windows, lines, values),
        name=name,
        label=f"Record {record.name}: |v|, i_d, i_q, p and q over time, measured and "
        f"{', '.join(lines)}; errors in the table.",
        size=(7.4, 8.2),
        rows=5,
        zoom=True,
    )


def _draw(
    axes: Sequence[Axes],
    record: EventRecord,
    windows: Mapping[str, tuple[float, float]],
    lines: Mapping[str, np.ndarray],
    values: Mapping[str, float],
) -> None:
    measured = _quantities(record, record.i)
    for number, plane in enumerate(axes):
        for window in SHADED:
            if window in windows:
                plane.axvspan(*windows[window], color=MUTED, alpha=0.12, linewidth=0)
        plane.plot(
            record.time,
            measured[number][1],
            color=MUTED,
            linewidth=3.0,
            alpha=0.6,
            label="measured",
        )
        if number:
            for index, (label, current) in enumerate(lines.items()):
                colour, _, dashes = series(index)
                shown = _quantities(record, current)[number][1]
                plane.plot(
                    record.time, shown, color=colour, linestyle=dashes, linewidth=1.0, label=label
                )
        _draw_levels(plane, measured[number][0], values)
        plane.set_ylabel(f"{measured[number][0]}  (pu)")
    axes[1].legend(loc="best")
    axes[-1].set_xlabel("time  (s)")


def _draw_levels(plane: Axes, curve: str, values: Mapping[str, float]) -> None:
    """Lines where limits begin to act, of those that the curve comes near to."""
    low, high = plane.get_ylim()
    near = NEAR * (high - low)
    for name, (curves, levels) in LEVELS.items():
        for level in levels(values[name]) if name in values and curve in curves else ():
            if low - near < level < high + near:
                plane.axhline(level, color=INK, linewidth=0.8, linestyle=":")
                words = name.split(".")[1]
                plane.text(
                    0.005, level, words, transform=plane.get_yaxis_transform(), va="bottom", size=8
                )


def _quantities(record: EventRecord, i: np.ndarray) -> tuple[tuple[str, np.ndarray], ...]:
    v = record.v
    p, q = (v * i).sum(axis=1), v[:, 1] * i[:, 0] - v[:, 0] * i[:, 1]
    return ("|v|", np.hypot(*v.T)), ("i_d", i[:, 0]), ("i_q", i[:, 1]), ("p", p), ("q", q)
