"""The first look at a sweep: noise, conditioning, passivity, coverage, conventions, and what to be
careful about.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import exp
from os import PathLike
from pathlib import Path
from typing import Any, overload

import numpy as np

from ibrid.border import takes_kinds
from ibrid.errors import SweepError, where_it_is_said
from ibrid.frozen import Frozen
from ibrid.measurement.conventions.contradictions import Conventions, check_conventions
from ibrid.measurement.conventions.positive_sequence import NOTE, WORDS
from ibrid.measurement.quality.coverage import (
    HarmonicLine,
    LoopCoverage,
    Resonance,
    harmonic_lines,
    loop_coverage,
    outliers,
    resonances,
)
from ibrid.measurement.quality.event_inspection import EventsInspection, inspect_events
from ibrid.measurement.quality.passivity import passivity
from ibrid.measurement.quality.plausibility import implausible_numbers
from ibrid.measurement.quality.sequence_view import SequenceView, sequence_view
from ibrid.measurement.quality.shifted_entries import shifted_entries
from ibrid.measurement.quality.wrong_rows import WrongRow, contradicted_rows, wrong_rows
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.amplitudes import levels_of
from ibrid.measurement.sweeps.linearity import linearity
from ibrid.measurement.sweeps.noise import (
    SIMULATED,
    PointNoise,
    Source,
    estimate,
    points_per_decade,
)
from ibrid.measurement.sweeps.quantities import counted, hertz, percent
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, PowerNode, Sweep
from ibrid.ranges import require_in_range
from ibrid.showing import brief, made_above, shown
from ibrid.writing import plain, write_json


@dataclass(frozen=True)
class PointInspection(Frozen):
    """One operating point. Frequencies in Hz, admittances per unit.

    noise, noise_worst : rms error of the matrix over ||Y||_F, median and largest over frequency;
    None if unknown.
    condition : largest condition number of Y.
    smallest_eigenvalue : of the Hermitian part of -Y; negative: the inverter is active there.
    active_bands : where it is negative beyond twice its uncertainty.
    outliers : frequencies that stick out of their neighbours (only seen with 15 points a decade or
    more).
    wrong_rows : rows that all others contradict, with the likely mistake.
    above_half_sampling : number of points there; None if the sampling rate is not known.
    rises : multiple of f0 in dq -> how many times as large as beside it the impedance is there that
    the positive and the
        negative sequence see. resistance : of Z along and across the current at rest, per unit;
        None where it is not seen.
    amplitudes : of the injection, the smallest of each sweep of this point, ascending; () where
    they are not recorded. All
        other numbers are of the first.
    """

    op: OperatingPoint
    points: int
    lowest: float
    highest: float
    points_per_decade: float
    repeats: int
    noise_source: Source
    noise: float | None
    noise_worst: float | None
    noise_worst_at: float | None
    condition: float
    condition_at: float
    smallest_eigenvalue: float
    smallest_eigenvalue_at: float
    active_bands: tuple[tuple[float, float], ...]
    loops: tuple[LoopCoverage, ...]
    resonances: tuple[Resonance, ...]
    lines: tuple[HarmonicLine, ...]
    outliers: tuple[float, ...]
    wrong_rows: tuple[WrongRow, ...]
    above_half_sampling: int | None
    rises: dict[int, tuple[float, float]]
    resistance: tuple[float, float] | None
    amplitudes: tuple[float, ...] = ()

    @property
    def noise_db(self) -> float | None:
        """Signal to noise of the matrix in dB, the number that add_noise takes."""
        return None if self.noise is None else float(-20 * np.log10(self.noise))


#: Where inspections are written as text.
_TABLE = "ibrid.measurement.quality.inspection_table"


@dataclass(frozen=True, repr=False)
class Inspection:
    """What the first look at a sweep finds."""

    source: str
    f0_hz: float
    power_node: PowerNode
    s_base_va: float | None
    v_base_v: float | None
    sampling_hz: float | None
    points: tuple[PointInspection, ...]
    conventions: Conventions
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        names = "; ".join(point.op.name for point in self.points)
        return brief(
            f"<Inspection: {self.source or 'sweep'}, {counted(len(self.points), 'operating point')}"
            f" ({names})",
            f", {counted(len(self.warnings), 'warning')}>",
        )

    def __str__(self) -> str:
        """The table that `ibrid inspect` prints."""
        return made_above(self, _TABLE, "format_inspection")

    def _repr_html_(self) -> str:
        """The table and the warnings, for notebooks."""
        return shown(self, "pages.notebook", "inspection_html")

    def plot(self, ax: Any = None) -> Any:
        """A matplotlib figure, or `ax`: over frequency the range of each operating point, where it
        is active, resonances, and points that look wrong.
        """
        return shown(self, "plotting", "inspection_plot", ax)

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with a row for each operating point."""
        return made_above(self, "ibrid.measurement.dataframe", "inspection_frame")

    def save(self, path: str | PathLike[str]) -> None:
        """Write the JSON of `to_json`, replacing the file atomically."""
        write_json(Path(path), self.to_json())

    def to_json(self) -> dict[str, object]:
        """Plain numbers, text, lists and dictionaries; unknown is None."""
        result = {"schema": "ibrid.inspection/1", **asdict(self)}
        for entry, point in zip(result["points"], self.points, strict=True):
            entry["noise_db"] = point.noise_db
        return plain(result)


@overload
def inspect(sweep: Sweep, *, sampling_hz: float | None = None) -> Inspection: ...
@overload
def inspect(sweep: Events) -> EventsInspection: ...
@overload
def inspect(sweep: str | PathLike[str], **keys: Any) -> Inspection | EventsInspection: ...
@takes_kinds
def inspect(
    sweep: Sweep | Events, *, sampling_hz: float | None = None, **keys: Any
) -> Inspection | EventsInspection:
    """Look at a sweep, or at records of events, before fitting anything to it.

    sweep : either, its file, the name of a shipped sweep, or a DataFrame.
    sampling_hz : sampling rate of the controller, where a sweep does not carry it.
    keys : what a file or a DataFrame does not say about itself (base, f0_hz, map, channels, ..), as
    of `ibrid.read_sweep` and `ibrid.read_events`.
    """
    if keys:
        one = next(iter(keys))
        raise SweepError(
            f"{one} is no argument for what was read, which says of itself what a file may leave "
            "open: leave it out; of a sweep sampling_hz may be said"
        )
    if isinstance(sweep, Events):
        if sampling_hz is not None:
            raise SweepError("sampling_hz is said of sweeps; records have times, leave it out.")
        return inspect_events(sweep)
    if sampling_hz is not None:
        require_in_range("sampling_hz", sampling_hz, "sampling_hz")
    noise = estimate(sweep)
    rate = sampling_hz or sweep.sampling_hz
    seen = sequence_view(sweep)
    points = tuple(
        _inspect_point(point, noise[point.op.name], seen, sweep.f0_hz, rate)
        for point in sweep.points
    )
    conventions = check_conventions(sweep, noise)
    return Inspection(
        source=sweep.source,
        f0_hz=sweep.f0_hz,
        power_node=sweep.power_node,
        s_base_va=sweep.s_base_va,
        v_base_v=sweep.v_base_v,
        sampling_hz=rate,
        points=points,
        conventions=conventions,
        warnings=tuple(map(where_it_is_said, warnings_of(sweep, points, conventions, rate, seen))),
    )


def _inspect_point(
    point: PointSweep,
    noise: PointNoise,
    seen: SequenceView,
    f0_hz: float,
    sampling_hz: float | None,
) -> PointInspection:
    frequency = point.frequency
    condition = np.nan_to_num(np.linalg.cond(point.admittance), nan=np.inf, posinf=np.inf)
    active = passivity(point, noise)
    worst = None if noise.relative is None else int(np.argmax(noise.relative))
    sticking = outliers(point)
    return PointInspection(
        op=point.op,
        points=len(frequency),
        lowest=float(frequency[0]),
        highest=float(frequency[-1]),
        points_per_decade=points_per_decade(frequency),
        repeats=1 if point.repeats is None else len(point.repeats),
        noise_source=noise.source,
        noise=noise.level,
        noise_worst=None
        if noise.relative is None or worst is None
        else float(noise.relative[worst]),
        noise_worst_at=None if worst is None else float(frequency[worst]),
        condition=float(condition.max()),
        condition_at=float(frequency[np.argmax(condition)]),
        smallest_eigenvalue=float(active.smallest.min()),
        smallest_eigenvalue_at=float(frequency[np.argmin(active.smallest)]),
        active_bands=active.bands,
        loops=loop_coverage(frequency),
        resonances=resonances(point, noise),
        lines=harmonic_lines(point, f0_hz),
        outliers=() if sticking is None else tuple(float(value) for value in frequency[sticking]),
        wrong_rows=wrong_rows(point),
        above_half_sampling=None
        if sampling_hz is None
        else int((frequency > sampling_hz / 2).sum()),
        rises={
            n: (exp(plus), exp(minus)) for n, (plus, minus) in seen.peaks[point.op.name].items()
        },
        resistance=next(
            (
                (along, across)
                for name, _, along, across in seen.resistance
                if name == point.op.name
            ),
            None,
        ),
        amplitudes=tuple(
            float(one.amplitude.min()) for one in levels_of(point) if one.amplitude is not None
        ),
    )


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
    sentences = [WORDS] if NOTE in sweep.notes else []
    sentences += [
        *contradicted_rows(sweep),
        *shifted_entries(sweep),
        *conventions.warnings,
        *implausible_numbers(sweep, sampling_hz),
    ]
    amplitudes = linearity(sweep)
    sentences += [] if amplitudes is None or not amplitudes.bands else [amplitudes.sentence]
    simulated = any(note.startswith(SIMULATED) for note in sweep.notes)
    checks = (
        _setpoints,
        _number_of_points,
        _noise,
        _coverage,
        _resonances,
        partial(_lines, simulated=simulated),
        _outliers,
        _conditioning,
    )
    return (
        *sentences,
        *seen.sentences,
        *(sentence for check in checks for sentence in check(points)),
    )


def _setpoints(points: Sequence[PointInspection]) -> Iterator[str]:
    if len(points) == 1:
        yield (
            "one operating point: what acts through p and q (power loops, PLL, equilibrium) has no "
            "second view "
            "and nothing can be held out; measure a second one with another q, and a third with "
            "another p."
        )
    seen: dict[tuple[float, float, float], str] = {}
    for point in points:
        if (same := seen.setdefault(point.op.pqv, point.op.name)) != point.op.name:
            yield (
                f"{same} and {point.op.name} have the same p, q, v: they are one operating point "
                "to a model."
            )
            return


def _number_of_points(points: Sequence[PointInspection]) -> Iterator[str]:
    if names := _names(points, lambda point: point.points < FEW_POINTS):
        yield (
            f"fewer than {FEW_POINTS} frequencies ({names}): hardly any structure can be told "
            "apart."
        )


def _noise(points: Sequence[PointInspection]) -> Iterator[str]:
    if unknown := _names(points, lambda point: point.noise_source == "unknown"):
        yield (
            f"noise unknown ({unknown}): no sigma, no repeats, fewer than 15 points a decade, and "
            "vector fits leave too "
            "little or too much to tell, so how well a model should fit cannot be said; add a "
            "column sigma or repeat the sweep."
        )
    noisy = [point for point in points if point.noise is not None and point.noise > NOISY]
    if noisy:
        worst = max(noisy, key=lambda point: point.noise or 0)
        yield (
            f"noisy: {percent(worst.noise or 0)} of |Y| at the median frequency of "
            f"{worst.op.name}; "
            "a fit should weigh by it, and effects smaller than that are visible only through many "
            "points."
        )


def _coverage(points: Sequence[PointInspection]) -> Iterator[str]:
    for k, loop in enumerate(points[0].loops):
        most = max(point.loops[k].points for point in points)
        if most == 0:
            side = "below" if loop.high <= points[0].lowest else "above"
            edge = hertz(points[0].lowest if side == "below" else points[0].highest)
            verb = "act" if loop.loop.endswith("loops") else "acts"
            yield (
                f"no point {side} {edge}, where {loop.loop} usually {verb}: "
                "the parameters will be uncertain unless the effect reaches into the measured "
                "range."
            )


def _resonances(points: Sequence[PointInspection]) -> Iterator[str]:
    thin = dict.fromkeys(
        hertz(peak.frequency) for point in points for peak in point.resonances if peak.points < 3
    )
    if thin:
        yield (
            f"the peak at {', '.join(thin)} is spanned by fewer than three points: height, damping "
            "and true frequency "
            "between the points are guesses, measure more densely there."
        )


def _lines(points: Sequence[PointInspection], *, simulated: bool = False) -> Iterator[str]:
    """Points where the grid's own harmonics disturb; there is no grid behind a simulated device."""
    orders = sorted({line.order for point in points for line in point.lines})
    sticking = sorted({line.order for point in points for line in point.lines if line.outlying})
    text = (
        f"points on f0 times {', '.join(map(str, orders[:8]))}{' ..' if len(orders) > 8 else ''}: "
    )
    if sticking:
        yield (
            f"{text}those at {', '.join(map(str, sticking[:8]))} stick out, background harmonics? "
            "Leave them out."
        )
    elif orders and not simulated:
        yield (
            f"{text}background harmonics of the grid add to the response there, compare with their "
            "neighbours."
        )


def _outliers(points: Sequence[PointInspection]) -> Iterator[str]:
    listed = []
    for point in points:
        named = {row.frequency for row in point.wrong_rows}
        if sticking := [frequency for frequency in point.outliers if frequency not in named]:
            listed.append(f"{point.op.name}: {', '.join(map(hertz, sticking[:6]))}")
    if listed:
        yield f"single points stick out of their neighbours ({'; '.join(listed)}): check them."


def _conditioning(points: Sequence[PointInspection]) -> Iterator[str]:
    if names := _names(points, lambda point: point.condition > ILL_CONDITIONED):
        yield (
            f"Y is nearly singular at some frequencies ({names}): the smaller direction of it is "
            "known poorly there."
        )


def _names(points: Sequence[PointInspection], test: Callable[[PointInspection], bool]) -> str:
    names = [point.op.name for point in points if test(point)]
    return "all operating points" if len(names) == len(points) > 1 else ", ".join(names)
