"""What acts at a port: the port map as bars, the transfer that was measured there, its gain over
the amplitude.
"""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import chdtri

from ibrid.fit.adequacy import LEAST_P, NEGLIGIBLE
from ibrid.gap.amplitudes.port_gain import PortGain
from ibrid.gap.ports.missing_transfer import MissingTransfer
from ibrid.gap.ports.port_map import PortFit
from ibrid.report.look.numbers import number
from ibrid.report.look.style import INK, MUTED, SERIES_STAND_INS, Axes, plain_decades, series

#: Ports that the page's figure shows at most.
PORTS = 20
#: Letters in a line of a port's name, their size in points, and points between a name and the axes.
LETTERS, LETTER_SIZE, APART = 44, 9.0, 16.0
#: Error bars reach this many standard deviations.
BARS = 2.0
#: Largest over smallest magnitude from which on its axis is logarithmic.
DECADE = 10.0


def draw_ports(axes: Sequence[Axes], fits: Sequence[PortFit], most: int = PORTS) -> None:
    """chi2 per degree of freedom with one unknown transfer at each port, best on top; what is
    adequate is hatched green.
    """
    (plane,) = axes
    shown = list(fits[:most])[::-1]
    heights = np.arange(len(shown))
    values = np.array([max(one.chi2_per_dof, 1e-6) for one in shown])
    low = 0.7 * min(0.7, float(values.min()))
    for height, value, fit in zip(heights, values, shown, strict=True):
        look: dict[str, Any] = {"color": MUTED, "alpha": 0.5}
        if fit.adequate:
            look = {
                "facecolor": SERIES_STAND_INS[2],
                "edgecolor": INK,
                "hatch": "///",
                "linewidth": 0.6,
            }
        plane.barh(height, value - low, left=low, height=0.62, **look)
        words = f"{number(value, 3)}{'  adequate' if fit.adequate else ''}"
        plane.annotate(
            words, (value, height), (4, 0), textcoords="offset points", va="center", fontsize=8.5
        )
    plane.set_xscale("log")
    plane.set_xlim(
        low, max(10.0, float(values.max()) * max(8.0, (float(values.max()) / low) ** 0.2))
    )
    plane.axvline(limit_of(fits), color=MUTED, linewidth=1.0, linestyle=(0, (5, 3)))
    plane.set_yticks(heights, list(map(_name, shown)), fontsize=LETTER_SIZE)
    plane.set_ylim(-0.6, len(shown) - 0.4)
    plane.grid(False, axis="y")
    plane.set_xlabel("chi2 per degree of freedom")
    plain_decades(plane.xaxis)


def room_for_names(fits: Sequence[PortFit]) -> float:
    """Inches left of the axes that the names of the ports take."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=LETTER_SIZE)
    lines = [line for one in fits[:PORTS] for line in _name(one).splitlines()]
    widths = [
        text_to_path.get_text_width_height_descent(line, font, ismath=False)[0] for line in lines
    ]
    return float(max(widths, default=0.0) + APART) / 72.0


def _name(one: PortFit) -> str:
    return textwrap.fill(one.port.words, LETTERS)


def limit_of(fits: Sequence[PortFit]) -> float:
    """chi2 per degree of freedom up to which a port is adequate; nearly the same for all."""
    dof = float(np.median([one.dof for one in fits]))
    return max(float(chdtri(dof, LEAST_P)) / dof, 1.0 + NEGLIGIBLE)


def draw_missing(axes: Sequence[Axes], shown: MissingTransfer) -> None:
    """Magnitude and phase (degrees) of the measured transfer with error bars, and the named block's
    curve through them.
    """
    magnitude, phase = axes
    seen, frequency = shown.seen, shown.fit.frequency[shown.seen]
    value, bar = shown.value[seen], BARS * shown.deviation[seen]
    size, angle = np.abs(value), np.degrees(np.unwrap(np.angle(value)))
    look: dict[str, Any] = {
        "color": INK,
        "marker": "o",
        "linestyle": "none",
        "markersize": 4.5,
        "markerfacecolor": "none",
        "elinewidth": 0.9,
    }
    magnitude.errorbar(frequency, size, yerr=np.stack([np.minimum(bar, 0.9 * size), bar]), **look)
    phase.errorbar(
        frequency, angle, yerr=np.degrees(np.arcsin(np.minimum(bar / size, 1.0))), **look
    )
    if shown.line is not None:
        turn = np.degrees(np.unwrap(np.angle(shown.line)))
        if seen.any():  # on the same sheet as the dots
            turn += 360.0 * np.round(
                np.median(angle - np.interp(frequency, shown.frequency, turn)) / 360.0
            )
        colour, _, dashes = series(0)
        for plane, drawn in ((magnitude, np.abs(shown.line)), (phase, turn)):
            plane.plot(shown.frequency, drawn, color=colour, linestyle=dashes, linewidth=1.8)
    low, high = _reach(magnitude)
    if low > 0 and high > DECADE * low:
        magnitude.set(yscale="log", ylim=(low / 1.6, high * 1.6))
    else:
        magnitude.set_ylim(max(0.0, low - 0.25 * high), 1.25 * high)
    low, high = _reach(phase)
    phase.set_ylim(low - 15.0, high + 15.0)
    magnitude.set_ylabel("|1 + Delta|" if shown.fit.port.series else "|Delta|")
    phase.set(ylabel="phase  (deg)", xlabel="frequency  (Hz)", xscale="log")
    plain_decades(phase.xaxis, magnitude.yaxis)


def draw_gain(axes: Sequence[Axes], gain: PortGain, amplitudes: Sequence[float]) -> None:
    """Real part of measured gains over the amplitude at the port with the describing function, and
    the imaginary part.
    """
    real, imaginary = axes
    real.plot(*gain.curve, color=INK, linewidth=1.6, zorder=1)
    imaginary.axhline(0.0, color=INK, linewidth=1.2, zorder=1)
    for level in np.unique(gain.level):
        mine = gain.level == level
        colour, marker, _ = series(int(level))
        look = {
            "color": colour,
            "marker": marker,
            "linestyle": "none",
            "markersize": 4.5,
            "markerfacecolor": "none",
            "elinewidth": 0.8,
            "label": f"injected {amplitudes[int(level)]:g} pu",
        }
        for plane, part in ((real, np.real(gain.gain)), (imaginary, np.imag(gain.gain))):
            plane.errorbar(
                gain.amplitude[mine], part[mine], yerr=2.0 * gain.deviation[mine], **look
            )
    real.set(xscale="log", ylim=(-0.25, 1.35), ylabel="gain, real part")
    imaginary.set(
        ylim=(-0.45, 0.45), ylabel="imaginary", xlabel="amplitude at the port over the threshold"
    )
    for plane in axes:
        plane.axvline(1.0, color=MUTED, linewidth=0.8, linestyle=(0, (5, 3)))
    real.legend(loc="best", fontsize=9)


def _reach(plane: Axes) -> tuple[float, float]:
    """Ends of dots and lines; long error bars may leave the picture."""
    found = np.concatenate(
        [np.asarray(line.get_ydata(), dtype=float) for line in plane.get_lines()]
    )
    return (float(found.min()), float(found.max())) if found.size else (0.0, 1.0)
