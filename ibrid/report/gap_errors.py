"""How large the gap is: errors of the model as given, refitted and repaired against what noise alone would leave."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibrid.evaluation.errors_by_part import nrmse
from ibrid.fit.objective import BAND_NAMES, band_index
from ibrid.gap.result import Gap
from ibrid.measurement.sweep import ENTRIES
from ibrid.report.gap_curves import Line, PointView
from ibrid.report.numbers import percent

#: An error up to this multiple of what noise alone leaves is noise.
NOISE_MARGIN = 1.5


def errors_by_point(gap: Gap, views: Sequence[PointView]) -> list[tuple[Any, ...]]:
    """(operating point, as given, refitted, repaired, noise alone, which part of the gap is closed), the mean first."""
    mean = (gap.before.get("nominal"), gap.before.get("refit"), gap.after.get("refit"), gap.noise_floor)
    rows = [("mean of the fitted", *mean, closed(*mean[1:]))]
    for view in views:
        errors = {"repaired": {**gap.repaired.nrmse_by_op, **gap.repaired.holdout}.get(view.name)}
        errors |= {line.name: nrmse(line.at_data, view.point) for line in view.lines}
        before, after = errors.get("refitted"), errors.get("repaired")
        noise = _noise(view) if view.known else None
        name = f"{view.name}, held out" if view.held_out else view.name
        rows.append((name, errors.get("as given"), before, after, noise, closed(before, after, noise)))
    return rows


def closed(before: float | None, after: float | None, noise: float | None) -> str:
    """1 - (after - noise)/(before - noise) as a percentage, "-" where there was no gap to close."""
    floor = noise or 0.0
    if before is None or after is None or before <= NOISE_MARGIN * floor or before == 0:
        return "-"
    return percent(1.0 - max(after - floor, 0.0) / (before - floor))


def errors_by_part(views: Sequence[PointView]) -> dict[str, Any] | None:
    """Errors by band, entry and operating point of the last two states of the model; None where there is no line.

    `names` : of the states. `groups` : (operating point, [(band, [(error, whether noise alone may leave it)])]).
    """
    shown = [view for view in views if view.lines]
    if not shown:
        return None
    return {
        "names": [line.name for line in shown[0].lines[-2:]],
        "groups": [(f"{view.name} (held out)" if view.held_out else view.name, _parts(view)) for view in shown],
        "marked": any(view.known for view in shown),
        "margin": NOISE_MARGIN,
    }


def _parts(view: PointView) -> list[tuple[str, list[tuple[float | None, bool]]]]:
    bands = band_index(view.point.frequency)
    return [
        (name, [_part(view, line, (bands == index, *place)) for place in ENTRIES.values() for line in view.lines[-2:]])
        for index, name in enumerate(BAND_NAMES)
        if (bands == index).any()
    ]


def _part(view: PointView, line: Line, place: tuple[Any, ...]) -> tuple[float | None, bool]:
    norm = float(np.linalg.norm(view.point.admittance[place]))
    if norm == 0.0:
        return None, False
    value = float(np.linalg.norm(line.at_data[place] - view.point.admittance[place])) / norm
    return value, view.known and value <= NOISE_MARGIN * _noise(view, place)


def _noise(view: PointView, place: tuple[Any, ...] = ()) -> float:
    """What noise alone leaves of a part of (K, 2, 2), relative to its measured norm. place : its index; () is the whole."""
    return float(np.linalg.norm(view.noise[place]) / np.linalg.norm(view.point.admittance[place]))
