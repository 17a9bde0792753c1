"""How large the gap is: errors of the model as given, refitted and repaired against what noise alone would leave."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrid.evaluation.errors_by_part import nrmse
from ibrid.fit.objective import BAND_NAMES, band_index
from ibrid.gap.result import Gap
from ibrid.measurement.sweep import ENTRIES
from ibrid.report.gap_curves import Line, PointView, repaired
from ibrid.report.markup import cell, error_cell, escape, head, row, table
from ibrid.report.numbers import error, percent
from ibrid.report.style import heat

#: An error up to this multiple of what noise alone leaves is noise.
NOISE_MARGIN = 1.5


def summary_table(gap: Gap, views: Sequence[PointView]) -> str:
    """Errors by operating point: as given, refitted, repaired, noise alone, and which part of the gap is closed."""
    mean = [gap.before.get("nominal"), gap.before.get("refit"), gap.after.get("refit") if repaired(gap) else None]
    rows = [_summary_row(gap, "mean of the fitted", mean, gap.noise_floor)]
    for view in views:
        found = {"repaired": {**gap.repaired.nrmse_by_op, **gap.repaired.holdout}.get(view.name)}
        found |= {line.name: nrmse(line.at_data, view.point) for line in view.lines}
        values = [found.get(name) for name in ("as given", "refitted", "repaired")]
        words = f"{view.name}, held out" if view.held_out else view.name
        rows.append(_summary_row(gap, words, values, _noise(view) if view.known else None))
    names = ["NRMSE", "as given", "refitted", *(["repaired"] if repaired(gap) else []), "noise alone"]
    names += ["gap closed"] if repaired(gap) else []
    caption = "Norm of the difference over the norm of the measurement."
    if repaired(gap):
        caption += " The gap is what the refitted model leaves, so that wrong parameters do not count for a repair."
    if gap.held_out:
        caption += " Held out: predicted, never fitted."
    inner = head(names, numeric=range(1, len(names))) + f"<tbody>{''.join(rows)}</tbody>"
    return table("Error by operating point", caption, inner)


def _summary_row(gap: Gap, name: str, values: Sequence[float | None], noise: float | None) -> str:
    given, before, after = values
    cells = [error_cell(given), error_cell(before), *([error_cell(after)] if repaired(gap) else []), error_cell(noise)]
    if repaired(gap):
        cells.append(cell(closed(before, after, noise), numeric=True))
    return row(name, cells)


def closed(before: float | None, after: float | None, noise: float | None) -> str:
    """1 - (after - noise)/(before - noise) as a percentage, "-" where there was no gap to close."""
    floor = noise or 0.0
    if before is None or after is None or before <= NOISE_MARGIN * floor or before == 0:
        return "-"
    return percent(1.0 - max(after - floor, 0.0) / (before - floor))


def part_table(views: Sequence[PointView]) -> str:
    """Errors by band, entry and operating point, the last two states of the model beside each other."""
    shown = [view for view in views if view.lines]
    if not shown:
        return ""
    names = [line.name for line in _pair(shown[0])]
    groups = "".join(_group(view, 1 + len(ENTRIES) * len(names)) for view in shown)
    caption = f"The same in parts: {' and '.join(names)}, in the same band and entry."
    if any(view.known for view in shown):
        caption += f" ✓: no more than {NOISE_MARGIN} times what noise alone leaves there."
    return table("Error by band and entry", caption, _head(names) + groups)


def _head(names: Sequence[str]) -> str:
    """Entries, and below them the states of the model where there are two."""
    if len(names) == 1:
        return head(["band (Hz)", *(f"Y_{entry}" for entry in ENTRIES)], numeric=range(1, 1 + len(ENTRIES)))
    top = "".join(f'<th scope="colgroup" colspan="{len(names)}">Y<sub>{entry}</sub></th>' for entry in ENTRIES)
    below = "".join(f'<th scope="col" class="n">{escape(name)}</th>' for _ in ENTRIES for name in names)
    return f'<thead><tr><th scope="col" rowspan="2">band (Hz)</th>{top}</tr><tr>{below}</tr></thead>'


def _pair(view: PointView) -> tuple[Line, ...]:
    return view.lines[-2:]


def _group(view: PointView, width: int) -> str:
    words = f"{view.name} (held out)" if view.held_out else view.name
    bands = band_index(view.point.frequency)
    rows = [
        row(
            name.replace("-", "–"),
            [_cell(view, line, bands == index, entry) for entry in ENTRIES for line in _pair(view)],
        )
        for index, name in enumerate(BAND_NAMES)
        if (bands == index).any()
    ]
    title = f'<tr><th scope="rowgroup" colspan="{width}">{escape(words)}</th></tr>'
    return f"<tbody>{title}{''.join(rows)}</tbody>"


def _cell(view: PointView, line: Line, inside: np.ndarray, entry: str) -> str:
    place = (inside, *ENTRIES[entry])
    norm = float(np.linalg.norm(view.point.admittance[place]))
    if norm == 0.0:
        return error_cell(None)
    value = float(np.linalg.norm(line.at_data[place] - view.point.admittance[place])) / norm
    style = f' style="{heat(value)}"' if heat(value) else ""
    mark = " ✓" if view.known and value <= NOISE_MARGIN * _noise(view, place) else ""
    return f'<td class="n"{style}><data value="{value!r}">{escape(error(value))}</data>{mark}</td>'


def _noise(view: PointView, place: tuple[Any, ...] = ()) -> float:
    """What noise alone leaves of a part of (K, 2, 2), relative to its measured norm. place : its index; () is the whole."""
    return float(np.linalg.norm(view.noise[place]) / np.linalg.norm(view.point.admittance[place]))
