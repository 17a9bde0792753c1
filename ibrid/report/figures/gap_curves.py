"""What the figures and tables of a gap compare: measurement, model as given, refitted and repaired,
and what noise leaves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ibrid.errors import IbridError
from ibrid.evaluation.errors_by_part import nrmse
from ibrid.evaluation.record import Record
from ibrid.fit.objective import BAND_NAMES, band_index
from ibrid.gap.refitting.noise import estimate_noise
from ibrid.gap.results.gap import Gap
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep
from ibrid.report.figures.bode import Curves, draw_bode, line_frequency
from ibrid.report.look.numbers import percent
from ibrid.report.look.style import MUTED, Axes, plain_decades, series

#: Points of a model line.
DENSE = 240
#: Colours and dashes (`ibrid.report.look.style.series`) of the model's three states, also of their
#: words in legends.
REPAIRED, REFITTED, GIVEN = 0, 1, 3


@dataclass(frozen=True, eq=False)
class ModelLine:
    """A state of the model at one operating point.

    `name` : in legends. `index` : of its colour. `at_data` : (K, 2, 2) at the measured frequencies.
    `frequency`, `response` : (N,) Hz and (N, 2, 2), the same between them.
    """

    name: str
    index: int
    at_data: np.ndarray
    frequency: np.ndarray
    response: np.ndarray


@dataclass(frozen=True, eq=False)
class PointView:
    """One operating point.

    `point` : the measurement with the sigma it is judged by, whose noise is `known` or only taken
    to be no smaller. `held_out` : predicted, not fitted. `lines` : as given, refitted, repaired, as
    far as there are.
    """

    point: PointSweep
    known: bool
    held_out: bool
    lines: tuple[ModelLine, ...]

    @property
    def name(self) -> str:
        """The operating point."""
        return self.point.op.name

    @cached_property
    def noise(self) -> np.ndarray:
        """Root mean square of the noise of each complex number, (K, 2, 2)."""
        return np.sqrt(2.0) * np.asarray(self.point.sigma)

    @cached_property
    def curves(self) -> tuple[Curves, ...]:
        """For `draw_bode`: the lines, the measurement with the last of them."""
        dots = self.point if self.known else replace(self.point, sigma=None)
        last = len(self.lines) - 1
        return tuple(
            Curves(
                one.name, one.index, dots if number == last else None, one.frequency, one.response
            )
            for number, one in enumerate(self.lines)
        )


def repaired(gap: Gap) -> bool:
    """True when there is a model after the repair beside the refitted one."""
    return gap.repaired is not gap.baseline


def convention_of(gap: Gap) -> Convention:
    """How the data are written, as the repaired model reads them."""
    return Convention(angle=gap.angle) if gap.convention == Convention() else gap.convention


def comparable(gap: Gap) -> bool:
    """False where the repaired model answers in a convention that nobody told."""
    return gap.verdict != "data-convention" or convention_of(gap) != Convention()


def point_views(gap: Gap) -> tuple[PointView, ...]:
    """Every operating point of the data, those with the worst located misfit first, then the others
    in their order.
    """
    noise = estimate_noise(gap.sweep, gap.noise_level)
    names = noise.sweep.names
    worst = [one.place[0] for one in gap.located if one.place[0] in names]
    return tuple(
        _view(gap, noise.sweep.point(name), noise.known) for name in dict.fromkeys([*worst, *names])
    )


def _view(gap: Gap, point: PointSweep, known: bool) -> PointView:
    name, lines = point.op.name, []
    given = np.asarray(gap.nominal.get(name, np.nan))
    if np.isfinite(given).all():  # nominal values may have no operating point there
        lines.append(ModelLine("as given", GIVEN, given, point.frequency, given))
    lines.append(
        _line(
            "refitted", REFITTED if repaired(gap) else REPAIRED, gap.baseline, point, Convention()
        )
    )
    if repaired(gap) and comparable(gap):
        lines.append(_line("repaired", REPAIRED, gap.repaired, point, convention_of(gap)))
    return PointView(
        point, known, name in gap.held_out, tuple(line for line in lines if line is not None)
    )


def _line(
    name: str, index: int, record: Record, point: PointSweep, convention: Convention
) -> ModelLine | None:
    """A record's response as the data are written; None where the record has none."""
    exchanged = {label: other for pair in convention.labels for label, other in (pair, pair[::-1])}
    op = exchanged.get(point.op.name, point.op.name)
    frequency = line_frequency(record, op, (point.frequency[0], point.frequency[-1]), point, DENSE)
    try:
        response = record.response(op, frequency)
    except IbridError:
        return None
    response = convention.written(response, op)
    return ModelLine(
        name, index, response[np.isin(frequency, point.frequency)], frequency, response
    )


#: An error up to this multiple of what noise alone leaves is noise.
NOISE_MARGIN = 1.5


def errors_by_point(gap: Gap, views: Sequence[PointView]) -> list[tuple[Any, ...]]:
    """(operating point, as given, refitted, repaired, noise alone, which part of the gap is
    closed), the mean first.
    """
    mean = (
        gap.before.get("nominal"),
        gap.before.get("refit"),
        gap.after.get("refit"),
        gap.noise_floor,
    )
    rows = [("mean of the fitted", *mean, closed(*mean[1:]))]
    for view in views:
        errors = {"repaired": {**gap.repaired.nrmse_by_op, **gap.repaired.holdout}.get(view.name)}
        errors |= {line.name: nrmse(line.at_data, view.point) for line in view.lines}
        before, after = errors.get("refitted"), errors.get("repaired")
        noise = _noise(view) if view.known else None
        name = f"{view.name}, held out" if view.held_out else view.name
        rows.append(
            (name, errors.get("as given"), before, after, noise, closed(before, after, noise))
        )
    return rows


def closed(before: float | None, after: float | None, noise: float | None) -> str:
    """1 - (after - noise)/(before - noise) as a percentage, "-" where there was no gap to close."""
    floor = noise or 0.0
    if before is None or after is None or before <= NOISE_MARGIN * floor or before == 0:
        return "-"
    return percent(1.0 - max(after - floor, 0.0) / (before - floor))


def errors_by_part(views: Sequence[PointView]) -> dict[str, Any] | None:
    """Errors by band, entry and operating point of the last two states of the model; None where
    there is no line.

    `names` : of the states. `groups` : (operating point, [(band, [(error, whether noise alone may
    leave it)])]).
    """
    shown = [view for view in views if view.lines]
    if not shown:
        return None
    return {
        "names": [line.name for line in shown[0].lines[-2:]],
        "groups": [
            (f"{view.name} (held out)" if view.held_out else view.name, _parts(view))
            for view in shown
        ],
        "marked": any(view.known for view in shown),
        "margin": NOISE_MARGIN,
    }


def _parts(view: PointView) -> list[tuple[str, list[tuple[float | None, bool]]]]:
    bands = band_index(view.point.frequency)
    return [
        (
            name,
            [
                _part(view, line, (bands == index, *place))
                for place in ENTRIES.values()
                for line in view.lines[-2:]
            ],
        )
        for index, name in enumerate(BAND_NAMES)
        if (bands == index).any()
    ]


def _part(view: PointView, line: ModelLine, place: tuple[Any, ...]) -> tuple[float | None, bool]:
    norm = float(np.linalg.norm(view.point.admittance[place]))
    if norm == 0.0:
        return None, False
    value = float(np.linalg.norm(line.at_data[place] - view.point.admittance[place])) / norm
    return value, view.known and value <= NOISE_MARGIN * _noise(view, place)


def _noise(view: PointView, place: tuple[Any, ...] = ()) -> float:
    """What noise alone leaves of a part of (K, 2, 2), relative to its measured norm.

    place : its index; () is the whole.
    """
    return float(np.linalg.norm(view.noise[place]) / np.linalg.norm(view.point.admittance[place]))


#: The distance axis reaches at most this part below the least noise; what is smaller is drawn at
#: its end.
DEEPEST = 0.03


def draw_entry(axes: Sequence[Axes], entry: str, shown: PointView) -> None:
    """Three axes: magnitude (per unit), phase (degrees), distance |Y model - Y measured| (per unit)
    over the noise.
    """
    *bode, distance = axes
    draw_bode(bode, entry, shown.curves)
    bode[-1].set_xlabel("")
    place = (slice(None), *ENTRIES[entry])
    frequency, floor = shown.point.frequency, shown.noise[place]
    away = [np.abs(line.at_data[place] - shown.point.admittance[place]) for line in shown.lines]
    low = max(min(float(one.min()) for one in [*away, floor]), DEEPEST * float(floor.min())) / 1.5
    high = 2.0 * max(float(one.max()) for one in [*away, floor])
    distance.fill_between(
        frequency, floor, low, color=MUTED, alpha=0.22, linewidth=0, gid=f"noise-{entry}"
    )
    for line, size in zip(shown.lines, away, strict=True):
        colour, marker, dashes = series(line.index)
        look: dict[str, Any] = {
            "color": colour,
            "linestyle": dashes,
            "marker": marker,
            "markersize": 3.0,
            "label": line.name,
        }
        distance.plot(frequency, np.maximum(size, low), linewidth=1.1, **look)
    distance.set(yscale="log", ylim=(low, high), ylabel="distance  (pu)", xlabel="frequency  (Hz)")
    plain_decades(bode[0].yaxis, distance.yaxis, distance.xaxis)
