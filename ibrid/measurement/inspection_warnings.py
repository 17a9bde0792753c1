"""What an engineer should know before fitting: each warning a sentence that says why and what to do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from ibrid.measurement.conventions import Conventions
from ibrid.measurement.linearity import linearity
from ibrid.measurement.plausibility import implausible_numbers
from ibrid.measurement.positive_sequence import NOTE, WORDS
from ibrid.measurement.quantities import hertz, percent
from ibrid.measurement.sequence_view import SequenceView
from ibrid.measurement.sweep import Sweep

if TYPE_CHECKING:
    from ibrid.measurement.inspect import PointInspection

NOISY = 0.02
FEW_POINTS = 8
ILL_CONDITIONED = 1e3


def warnings_of(
    sweep: Sweep,
    points: Sequence[PointInspection],
    conventions: Conventions,
    sampling_hz: float | None,
    seen: SequenceView,
) -> tuple[str, ...]:
    """All warnings, the ones that invalidate everything else first."""
    found = [*([WORDS] if NOTE in sweep.notes else []), *conventions.warnings, *implausible_numbers(sweep, sampling_hz)]
    amplitudes = linearity(sweep)
    found += [] if amplitudes is None or not amplitudes.bands else [amplitudes.sentence]
    found += seen.sentences
    checks = (_setpoints, _number_of_points, _noise, _coverage, _resonances, _lines, _outliers, _conditioning)
    return tuple(found + [sentence for check in checks for sentence in check(points)])


def _setpoints(points: Sequence[PointInspection]) -> list[str]:
    if len(points) == 1:
        return [
            "one operating point: what acts through p and q (power loops, PLL, equilibrium) has no second view "
            "and nothing can be held out; measure a second one with another q, and a third with another p."
        ]
    seen: dict[tuple[float, float, float], str] = {}
    for point in points:
        key = (point.op.p, point.op.q, point.op.v)
        if key in seen:
            return [f"{seen[key]} and {point.op.name} have the same p, q, v: they are one operating point to a model."]
        seen[key] = point.op.name
    return []


def _number_of_points(points: Sequence[PointInspection]) -> list[str]:
    names = _names(points, lambda point: point.points < FEW_POINTS)
    return [f"fewer than {FEW_POINTS} frequencies ({names}): hardly any structure can be told apart."] if names else []


def _noise(points: Sequence[PointInspection]) -> list[str]:
    result = []
    unknown = _names(points, lambda point: point.noise_source == "unknown")
    if unknown:
        result.append(
            f"noise unknown ({unknown}): no sigma, no repeats, fewer than 15 points a decade, and vector fits leave too "
            "little or too much to tell, so how well a model should fit cannot be said; add a column sigma or repeat the sweep."
        )
    noisy = [point for point in points if point.noise is not None and point.noise > NOISY]
    if noisy:
        worst = max(noisy, key=lambda point: point.noise or 0)
        result.append(
            f"noisy: {percent(worst.noise or 0)} of |Y| at the median frequency of {worst.op.name}; "
            "a fit should weigh by it, and effects smaller than that are visible only through many points."
        )
    return result


def _coverage(points: Sequence[PointInspection]) -> list[str]:
    result = []
    for k, loop in enumerate(points[0].loops):
        most = max(point.loops[k].points for point in points)
        if most == 0:
            side = "below" if loop.high <= points[0].lowest else "above"
            edge = hertz(points[0].lowest if side == "below" else points[0].highest)
            verb = "act" if loop.loop.endswith("loops") else "acts"
            result.append(
                f"no point {side} {edge}, where {loop.loop} usually {verb}: "
                "the parameters will be uncertain unless the effect reaches into the measured range."
            )
    return result


def _resonances(points: Sequence[PointInspection]) -> list[str]:
    thin: dict[str, list[str]] = {}
    for point in points:
        for peak in point.resonances:
            if peak.points < 3:
                thin.setdefault(f"{hertz(peak.frequency)}", []).append(point.op.name)
    if not thin:
        return []
    where = ", ".join(thin)
    return [
        f"the peak at {where} is spanned by fewer than three points: height, damping and true frequency "
        "between the points are guesses, measure more densely there."
    ]


def _lines(points: Sequence[PointInspection]) -> list[str]:
    orders = sorted({line.order for point in points for line in point.lines})
    if not orders:
        return []
    sticking = sorted({line.order for point in points for line in point.lines if line.outlying})
    text = f"points on f0 times {', '.join(map(str, orders[:8]))}{' ..' if len(orders) > 8 else ''}: "
    if sticking:
        return [f"{text}those at {', '.join(map(str, sticking[:8]))} stick out, background harmonics? Leave them out."]
    return [f"{text}background harmonics of the grid add to the response there, compare with their neighbours."]


def _outliers(points: Sequence[PointInspection]) -> list[str]:
    listed = [f"{point.op.name}: {', '.join(map(hertz, point.outliers[:6]))}" for point in points if point.outliers]
    return [f"single points stick out of their neighbours ({'; '.join(listed)}): check them."] if listed else []


def _conditioning(points: Sequence[PointInspection]) -> list[str]:
    names = _names(points, lambda point: point.condition > ILL_CONDITIONED)
    if not names:
        return []
    return [f"Y is nearly singular at some frequencies ({names}): the smaller direction of it is known poorly there."]


def _names(points: Sequence[PointInspection], test: Callable[[PointInspection], bool]) -> str:
    names = [point.op.name for point in points if test(point)]
    return "all operating points" if len(names) == len(points) > 1 else ", ".join(names)
