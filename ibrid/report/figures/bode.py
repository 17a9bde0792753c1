"""Bode plots of one entry of the admittance: measured dots and model lines of every operating
point.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, Sweep
from ibrid.report.look.figure import inline_svgs
from ibrid.report.look.style import Axes, series

#: Points of a model line.
DENSE = 500
#: Poles with less damping than this get points of their own, so many on a peak, to so many half
#: widths on each side.
SHARP, PEAK, REACH = 0.1, 25, 6.0
#: Error bars reach this many standard deviations.
BARS = 2.0
#: What lies this far below the largest value of its entry and of the matrix is rounding, not
#: admittance.
ROUNDING = 1e-9
#: Labels of an axis of phases at most, and degrees that it shows beyond the last of them.
MOST_TICKS, EDGE = 6, 8.0


@dataclass(frozen=True)
class Curves:
    """One operating point, `index` choosing its colour. `frequency`, `model` : (N,) Hz and (N, 2,
    2), or None.

    `half_width` : (N, 2, 2) of the model's band, equal for real and imaginary parts; shaded where
    it is given.
    """

    name: str
    index: int
    measured: PointSweep | None
    frequency: np.ndarray | None
    model: np.ndarray | None
    half_width: np.ndarray | None = None


def curves(record: Record, sweep: Sweep | None, with_model: bool = True) -> tuple[Curves, ...]:
    """Everything that Bode plots show, for the record's operating points in their order.

    Raises IbridError where the record cannot answer (a module kind that is not in its vocabulary).
    """
    all_curves = []
    low, high = record.settings["frequency_hz"]
    for index, name in enumerate(record.parameters):
        point = sweep.point(name) if sweep is not None and name in sweep.names else None
        frequency = line_frequency(record, name, (low, high), point, DENSE)
        model = record.response(name, frequency) if with_model else None
        all_curves.append(Curves(name, index, point, frequency, model))
    return tuple(all_curves)


def line_frequency(
    record: Record, op: str, ends: tuple[float, float], point: PointSweep | None, count: int
) -> np.ndarray:
    """Frequencies in Hz, rising, at which a model line is drawn between `ends`.

    `count` of them logarithmically spaced, those of the measurement, so that the line meets its
    dots, and more around sharp resonances, which a reader may enlarge.
    """
    low, high = ends[0], max(ends[1], ends[0] * 1.001)
    frequency = np.geomspace(low, high, count)
    for real, imaginary in record.poles.get(op, ()):
        size = float(np.hypot(real, imaginary))
        if imaginary > 0 and 1e-6 * size < abs(real) < SHARP * size:  # none on a pole itself
            around = (
                size
                * (1.0 + REACH * abs(real) / size * np.linspace(-1.0, 1.0, PEAK) ** 3)
                / (2 * np.pi)
            )
            frequency = np.union1d(frequency, around[(around > low) & (around < high)])
    return frequency if point is None else np.union1d(frequency, point.frequency)


def bode_svgs(
    shown: Sequence[Curves], name: str, label: str, *, zoom: bool = True, letter: str = "Y"
) -> dict[str, Markup]:
    """The four entries drawn; `name` : of this group; `label` : goes on after "Bode plot of Y_dd".

    zoom : False where no script runs, in notebooks. letter : of what is drawn.
    """
    drawings = {
        f"{name}-{entry}": (
            f"Bode plot of {letter}_{entry}{label}",
            lambda axes, entry=entry: draw_bode(axes, entry, shown),
        )
        for entry in ENTRIES
    }
    return dict(
        zip(
            ENTRIES,
            inline_svgs(drawings, size=(5.2, 3.8), rows=2, heights=(1.25, 1.0), zoom=zoom),
            strict=True,
        )
    )


def impedance_svgs(shown: Sequence[Curves], name: str, label: str) -> dict[str, Markup] | None:
    """The same of the impedance Z = Y^-1; None where no curve has one."""
    inverse = [curve for curve in map(impedance_of, shown) if curve is not None]
    return bode_svgs(inverse, name, label, letter="Z") if inverse else None


def impedance_of(curves: Curves) -> Curves | None:
    """Curves of Z = Y^-1 at the frequencies at which Y is regular; None where there are none.

    Deviations to first order: dZ = -Z dY Z, so that the variance of Z_ij is the sum of
    |Z_ik|^2 var(Y_kl) |Z_lj|^2 over independent entries.
    """
    measured, frequency, model = curves.measured, curves.frequency, curves.model
    if measured is not None:
        regular = _regular(measured.admittance)
        measured = _inverse_point(measured, regular) if regular.any() else None
    if model is not None and frequency is not None:
        regular = _regular(model)
        frequency = frequency[regular] if regular.any() else None
        model = np.linalg.inv(model[regular]) if regular.any() else None
    if measured is None and model is None:
        return None
    return Curves(curves.name, curves.index, measured, frequency, model)


def _regular(admittance: np.ndarray) -> np.ndarray:
    """(N,) where an inverse means something."""
    return np.linalg.cond(admittance) < 1 / ROUNDING


def _inverse_point(point: PointSweep, regular: np.ndarray) -> PointSweep:
    impedance = np.linalg.inv(point.admittance[regular])
    sigma = None
    if point.sigma is not None:
        weight = np.abs(impedance) ** 2
        sigma = np.sqrt(weight @ point.sigma[regular] ** 2 @ weight)
    frequency = point.frequency[regular]
    return PointSweep(point.op, frequency, impedance, sigma, predicted=point.predicted)


def draw_bode(axes: Sequence[Axes], entry: str, shown: Sequence[Curves]) -> None:
    """Magnitude (per unit) above phase (degrees) of one entry, dots measured, lines the model."""
    magnitude, phase = axes
    place = (slice(None), *ENTRIES[entry])
    floor = ROUNDING * max(
        (float(np.abs(array).max(initial=0.0)) for array in _arrays(shown)), default=0.0
    )
    angles = _phases(shown, entry, floor)
    drawn = False
    several = sum(curve.measured is not None for curve in shown) > 1
    for curve, (dots, angle) in zip(shown, angles, strict=True):
        colour, marker, dashes = series(curve.index)
        if curve.measured is not None:
            look = {"color": colour, "marker": marker}
            look["label"] = f"{curve.name}, measured" if several else "measured"
            drawn |= _dots(axes, curve.measured, entry, floor, dots, look)
        if curve.model is not None and curve.frequency is not None:
            line = curve.model[place]
            size = np.where(np.abs(line) > floor, np.abs(line), np.nan)
            if np.isfinite(size).any():
                drawn = True
                look = {"color": colour, "linestyle": dashes, "linewidth": 1.5}
                look["label"] = curve.name
                magnitude.plot(curve.frequency, size, **look)
                phase.plot(curve.frequency, angle, **look)
                if curve.half_width is not None:
                    _shade(
                        magnitude,
                        phase,
                        curve.frequency,
                        size,
                        angle,
                        curve.half_width[place],
                        colour,
                    )
    if drawn:
        magnitude.set_yscale("log")
    else:
        magnitude.text(
            0.5, 0.5, "zero throughout", ha="center", va="center", transform=magnitude.transAxes
        )
    magnitude.set_ylabel("magnitude  (pu)")
    low, high = _phase_range(angles)
    phase.set(ylabel="phase  (deg)", xlabel="frequency  (Hz)", xscale="log", ylim=(low, high))
    apart = 45 * 2 ** np.ceil(np.log2((high - low) / (45 * MOST_TICKS)))
    phase.set_yticks(np.arange(apart * np.ceil(low / apart), high, apart))


def _shade(
    magnitude: Axes,
    phase: Axes,
    frequency: np.ndarray,
    size: np.ndarray,
    angle: np.ndarray,
    half_width: np.ndarray,
    colour: str,
) -> None:
    """A band around a line, in magnitude and phase; a band that holds zero has no lower end and
    every phase.
    """
    look = {"color": colour, "alpha": 0.22, "linewidth": 0}
    magnitude.fill_between(
        frequency, np.maximum(size - half_width, 1e-3 * size), size + half_width, **look
    )
    inside = half_width < size
    turn = np.where(inside, np.degrees(np.arcsin(np.where(inside, half_width / size, 0.0))), 180.0)
    phase.fill_between(frequency, angle - turn, angle + turn, **look)


def _dots(
    axes: Sequence[Axes],
    point: PointSweep,
    entry: str,
    floor: float,
    angles: np.ndarray,
    look: dict[str, Any],
) -> bool:
    (magnitude, phase), value = axes, point.admittance[(slice(None), *ENTRIES[entry])]
    seen = np.abs(value) > floor
    if not seen.any():
        return False
    frequency, size, angle = (
        point.frequency[seen],
        np.abs(value[seen]),
        angles[seen],
    )
    few = seen.sum() <= 60
    look = {**look, "linestyle": "none", "markersize": 4.5 if few else 2.6, "markeredgewidth": 1.1}
    look |= {"markerfacecolor": "none" if few else look["color"]}
    if point.sigma is None:
        magnitude.plot(frequency, size, **look)
        phase.plot(frequency, angle, **look)
        return True
    bar = BARS * point.sigma[(seen, *ENTRIES[entry])]
    look |= {"elinewidth": 0.9}
    magnitude.errorbar(frequency, size, yerr=np.stack([np.minimum(bar, 0.9 * size), bar]), **look)
    phase.errorbar(
        frequency, angle, yerr=np.degrees(np.arcsin(np.minimum(bar / size, 1.0))), **look
    )
    return True


def _arrays(shown: Sequence[Curves]) -> list[np.ndarray]:
    measured = [one.measured.admittance for one in shown if one.measured is not None]
    return [one.model for one in shown if one.model is not None] + measured


def _phases(
    shown: Sequence[Curves], entry: str, floor: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Angles in degrees of the dots and of the line of each curve, without turns of 360 degrees
    between neighbours; dots beside a line take its turn, and all curves lie as near as turns let
    them. Nan where there is no admittance.
    """
    place, angles, middle = (slice(None), *ENTRIES[entry]), [], None
    for curve in shown:
        dots, line = np.empty(0), np.empty(0)
        if curve.model is not None and curve.frequency is not None:
            line = _unwrapped(curve.model[place], floor)
        if curve.measured is not None:
            dots = _unwrapped(curve.measured.admittance[place], floor)
            if np.isfinite(line).any() and curve.frequency is not None:
                finite = np.isfinite(line)
                beside = np.interp(curve.measured.frequency, curve.frequency[finite], line[finite])
                dots = dots - 360.0 * np.round((dots - beside) / 360.0)
        whole = np.concatenate([dots, line])
        if np.isfinite(whole).any():
            own = float(np.nanmedian(whole))
            turn = 360.0 * np.round((own - (0.0 if middle is None else middle)) / 360.0)
            dots, line, middle = dots - turn, line - turn, own - turn if middle is None else middle
        angles.append((dots, line))
    return angles


def _unwrapped(value: np.ndarray, floor: float) -> np.ndarray:
    """Angle in degrees along (N,) values; nan where they are not above `floor`."""
    angle, seen = np.full(len(value), np.nan), np.abs(value) > floor
    angle[seen] = np.degrees(np.unwrap(np.angle(value[seen])))
    return angle


def _phase_range(angles: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float]:
    """What an axis of phases shows: all, in whole steps of 45 degrees, and at least 180."""
    whole = np.concatenate([np.zeros(0), *(part for pair in angles for part in pair)])
    whole = whole[np.isfinite(whole)]
    if not len(whole):
        return -180.0, 180.0
    low, high = 45 * np.floor(whole.min() / 45), 45 * np.ceil(whole.max() / 45)
    more = max(180.0 - (high - low), 0.0) / 2
    return float(low - more - EDGE), float(high + more + EDGE)
