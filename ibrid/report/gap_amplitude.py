"""How a response depends on the injection amplitude: the bands, what was tried, and the gain of the port as measured."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ibrid.gap.amplitude_result import FEWEST, AmplitudeAnswer, PortGain
from ibrid.gap.result import Gap
from ibrid.measurement.quantities import span
from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.gap_words import p_value
from ibrid.report.markup import cell, data, escape, head, paragraph, row, table, value_cell
from ibrid.report.numbers import error, number, percent
from ibrid.report.style import INK, MUTED, series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Rows of a table at most.
ROWS = 12


def amplitude_html(answer: AmplitudeAnswer) -> str:
    """The section of a page."""
    found = answer.linearity
    shown = paragraph(f"{found.sentence} Noise: {found.noise}.")
    if answer.before is not None:
        words = f"Over all amplitudes the linear model leaves {error(answer.before)}"
        if answer.after is not None:
            words += f", with {answer.words} {error(answer.after)}"
        if answer.floor is not None:
            words += f"; noise alone would leave {error(answer.floor)}"
        shown += paragraph(f"{words}.")
    if len(found.refused):
        shown += paragraph(_left(answer))
    if answer.port_gain is not None:
        shown += _figure(answer, answer.port_gain)
    if found.bands:
        shown += _bands(answer)
    if answer.tried:
        shown += _tried(answer)
    return shown


def _left(answer: AmplitudeAnswer) -> str:
    """What the rest of the page compares, in one or two sentences."""
    count = len(answer.linearity.refused)
    refused = "One frequency is" if count == 1 else f"{count} frequencies are"
    words = f"{refused} refused to a small-signal model, {answer.kept} are left"
    words += ", too few for one." if answer.kept < FEWEST else "."
    if answer.after is None:
        return words
    against = "these" if answer.kept >= FEWEST else "all frequencies"
    return f"{words} Below, the model without its nonlinearity stands against the smallest amplitude at {against}."


def _figure(answer: AmplitudeAnswer, gain: PortGain) -> str:
    svg = inline_svg(
        lambda axes: draw_gain(axes, gain, answer.linearity.amplitudes),
        name="port-gain",
        label=f"Measured gain of {answer.words} against the amplitude at its port, real and imaginary part, and the "
        "describing function.",
        size=(7.4, 4.6),
        rows=2,
        heights=(2.2, 1.0),
    )
    words = (
        f"Dots: what must act at that place at each frequency, operating point and axis by itself, against the amplitude "
        f"there over the {'threshold' if answer.parameter == 'width' else 'room that the operating value leaves'}. A linear "
        "block would make them fall on as many heights as there are frequencies; one curve through all is a nonlinearity "
        "without memory. Line: its describing function. Bars: two standard errors."
    )
    return paragraph(words, "note") + figure_html(svg, style="medium")


def draw_gain(axes: Sequence["Axes"], gain: PortGain, amplitudes: Sequence[float]) -> None:
    """Real part of measured gains over the amplitude at the port with the describing function, and the imaginary part."""
    real, imaginary = axes
    real.plot(*gain.curve, color=INK, linewidth=1.6, zorder=1)
    imaginary.axhline(0.0, color=INK, linewidth=1.2, zorder=1)
    for level in np.unique(gain.level):
        mine = gain.level == level
        colour, marker, _ = series(int(level))
        look = {"color": colour, "marker": marker, "linestyle": "none", "markersize": 4.5, "markerfacecolor": "none",
                "elinewidth": 0.8, "label": f"injected {amplitudes[int(level)]:g} pu"}  # fmt: skip
        for plane, part in ((real, np.real(gain.gain)), (imaginary, np.imag(gain.gain))):
            plane.errorbar(gain.amplitude[mine], part[mine], yerr=2.0 * gain.deviation[mine], **look)
    real.set_xscale("log")
    real.set_ylim(-0.25, 1.35)
    imaginary.set_ylim(-0.45, 0.45)
    imaginary.axvline(1.0, color=MUTED, linewidth=0.8, linestyle=(0, (5, 3)))
    real.axvline(1.0, color=MUTED, linewidth=0.8, linestyle=(0, (5, 3)))
    real.set_ylabel("gain, real part")
    imaginary.set_ylabel("imaginary")
    imaginary.set_xlabel("amplitude at the port over the threshold")
    real.legend(loc="best", fontsize=9)


def _bands(answer: AmplitudeAnswer) -> str:
    rows = [
        row(one.op, [
            cell(span(*one.band)),
            cell(one.entry),
            cell(percent(one.change), numeric=True),
            cell(number(one.z, 3), numeric=True),
            cell("products of signals" if one.products else "beyond products: refused"),
        ])
        for one in answer.linearity.bands[:ROWS]
    ]  # fmt: skip
    more = len(answer.linearity.bands) - ROWS
    caption = (
        "Neighbouring frequencies at which an entry differs between amplitudes by more than noise. Change: over |Y|. "
        "Products: no more than what p = e' i and rotations do at these amplitudes."
        + (f" {more} more." if more > 0 else "")
    )
    names = ["operating point", "band", "entry", "change", "z", "size"]
    inner = head(names, numeric=(3, 4)) + f"<tbody>{''.join(rows)}</tbody>"
    return table("Where the response depends on the amplitude", caption, inner)


def _tried(answer: AmplitudeAnswer) -> str:
    rows = []
    for one in answer.tried:
        name = f"<code>{escape(one.id)}</code>" if one.id else "-"
        numbers = value_cell(max(one.gain, 0.0)) + value_cell(one.chi2_per_dof)
        rows.append(
            f'<tr><th scope="row">{escape(one.words)}</th><td><code>{escape(one.where)}</code></td><td>{name}</td>{numbers}'
            f'<td class="n">{data(one.p_value, p_value(one.p_value))}</td></tr>'
        )
    names = ["nonlinearity", "in the program", "effect", "fall of the cost", "chi2 / dof", "p value"]
    caption = (
        "Each with its threshold and all parameters fitted to all amplitudes; errors grow with the measured distortion."
    )
    inner = head(names, numeric=(3, 4, 5)) + f"<tbody>{''.join(rows)}</tbody>"
    return table("Nonlinearities that were tried", caption, inner)


def amplitude_lines(gap: Gap) -> Iterator[tuple[str, str]]:
    """(label, words) for the terminal; nothing where there is one amplitude."""
    if gap.amplitude is None:
        return
    found, label = gap.amplitude.linearity, "amplitudes"
    worst = [one for one in found.bands if not one.products] or list(found.bands)
    if not worst:
        yield label, f"{len(found.amplitudes)} of them, the response is the same"
    for one in worst[:2]:
        yield (
            label,
            (
                f"{one.op}, {one.entry}, {span(*one.band)}: changes by {percent(one.change)} of |Y|, z {number(one.z, 3)}"
            ),
        )
        label = ""
    if len(worst) > 2:
        yield (
            "",
            f"and {len(worst) - 2} more bands; {len(found.refused)} frequencies left out of the small-signal model",
        )
