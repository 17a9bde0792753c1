"""The page of stability in a grid: the answer on top, grids, root locus, eigenloci, passivity, modes."""

from collections.abc import Iterable, Iterator, Sequence

from ibrid.analysis.grid import SeriesRL
from ibrid.analysis.modes import QUANTILE, Mode
from ibrid.analysis.stability import PointStability, Stability
from ibrid.measurement.quantities import hertz
from ibrid.report.figure import figure_html, inline_svg
from ibrid.report.legend import points_legend
from ibrid.report.markup import (
    Section,
    bullets,
    cell,
    data,
    escape,
    head,
    page,
    page_header,
    paragraph,
    row,
    stable_or_not,
    table,
)
from ibrid.report.numbers import interval, number, percent
from ibrid.report.prediction_text import shown_modes
from ibrid.report.stability_figures import draw_eigenloci, draw_locus, draw_passivity, shown_cases
from ibrid.report.stability_text import CASE_HEAD, case_cells, grid_name, passivity_words


def stability_page(found: Stability, source: str = "") -> str:
    """The page as text; `source` : the record's name."""
    title = "Stability in a grid"
    above = "Identified inverter model" + (f": {source}" if source else "")
    words = (
        "SCR = 1/|Z| at 1 per unit of voltage; Nyquist and passivity use the load admittance -Y; v, p, q at the PCC stay "
        "those of the operating point."
    )
    header = page_header(above, title, f"{'; '.join(found.sentences)}.", stability_facts(found))
    return page(f"{title}: {source}" if source else title, header, stability_sections(found), words)


def stability_facts(found: Stability) -> Iterator[tuple[str, str]]:
    """What stands beside the verdict: critical ratios or verdicts, and the grid."""
    for one in found.points:
        for critical in one.critical:
            word = f"critical SCR at {one.op}"
            yield word, data(critical.scr, number(critical.scr, 4))
        if not one.critical:
            yield one.op, stable_or_not(all(case.stable for case in one.cases))
    if found.xr is not None:
        yield "X/R", number(found.xr)
    yield "nominal frequency", hertz(found.f0_hz)


def stability_sections(found: Stability, name: str = "", *, zoom: bool = True) -> Iterator[Section]:
    """The parts of the answer. `name` : goes before those of the figures; `zoom` : False where no script runs."""
    points = found.points
    if any(one.critical for one in points):
        yield "critical", "Critical short-circuit ratios", _critical(points)
    yield "grids", "On each grid", "".join(map(_grids, points))
    if any(one.cases[0].modes is not None for one in points):
        yield (
            "locus",
            "Root locus over the short-circuit ratio",
            _each(_locus(f"{name}locus-{index}", one) for index, one in enumerate(points)),
        )
    yield (
        "eigenloci",
        "Eigenloci of Z (-Y)",
        _each(_eigenloci(f"{name}loci-{index}", one, zoom) for index, one in enumerate(points)),
    )
    yield "passivity", "Passivity", _passivity(f"{name}passivity", points, zoom)
    yield "modes", "Modes on an ideal grid", "".join(modes_table(one.op, one.ideal) for one in points)
    warnings = list(dict.fromkeys(words for one in points for words in one.warnings))
    if warnings:
        yield "warnings", "Warnings", bullets(warnings)


def _critical(points: Sequence[PointStability]) -> str:
    lines = head(
        ["operating point", "from poles", "from Nyquist", "95 %", "unstable", "mode", "states"], numeric=(1, 2)
    )
    for one in points:
        for found in one.critical:
            band = "-" if found.interval is None else interval(found.scr, found.interval, None).replace("+-", "±")
            nyquist = found.scr_nyquist
            cells = [
                f'<td class="n">{data(found.scr, number(found.scr, 5))}</td>',
                f'<td class="n">{data(nyquist, number(nyquist, 5))}</td>',
                cell(band),
                cell(f"{found.unstable} it"),
                cell(hertz(found.mode.frequency) if found.mode.frequency else "no oscillation"),
                cell(_states(found.mode), wraps=True),
            ]
            lines += row(one.op, cells)
    caption = "Where a pole crosses the imaginary axis, and independently where the Nyquist count changes."
    return table("Critical short-circuit ratios", caption, lines)


def _grids(one: PointStability) -> str:
    first = "SCR" if isinstance(one.cases[0].grid, SeriesRL) else "grid"
    lines = head([first, *CASE_HEAD], numeric=(1, 6, 7))
    for case in one.cases:
        texts = case_cells(case)
        cells = [
            f'<td class="bad">{escape(text)}</td>' if "UNSTABLE" in text else cell(text, numeric=index in (0, 5, 6))
            for index, text in enumerate(texts)
        ]
        lines += row(grid_name(case), cells)
    caption = (
        f"{one.op}. |v_Th|: the source that keeps the operating point. Distance: of the nearest eigenlocus from -1. Gain: factor "
        "on the impedance up to instability. Phase in degrees."
    )
    return table(f"Grids at {one.op}", caption, lines)


def _each(drawn: Iterable[str]) -> str:
    return f'<div class="four">{"".join(drawn)}</div>'


def _locus(name: str, one: PointStability) -> str:
    label = f"Poles at {one.op} over the short-circuit ratio, real part against frequency."
    svg = inline_svg(lambda axes: draw_locus(axes, one), name=name, label=label, size=(5.2, 4.2))
    words = "Circles: the weakest grid; squares: the strongest; crosses: critical. Scales logarithmic away from zero."
    return figure_html(svg, escape(one.op), words)


def _eigenloci(name: str, one: PointStability, zoom: bool) -> str:
    label = f"Eigenloci of Z (-Y) at {one.op}; the table gives counts and distances from -1."
    svg = inline_svg(lambda axes: draw_eigenloci(axes, one), name=name, label=label, size=(5.2, 5.0), zoom=zoom)
    first = "SCR " if isinstance(one.cases[0].grid, SeriesRL) else ""
    names = [f"{first}{grid_name(case)}: {'stable' if case.stable else 'UNSTABLE'}" for case in shown_cases(one)]
    words = "Around -1. Radius log2(1 + size), so that the unit circle stays. Faint: negative frequencies."
    return f"<div><h3>{escape(one.op)}</h3>{points_legend(names, lines=True)}{figure_html(svg, words=words)}</div>"


def _passivity(name: str, points: Sequence[PointStability], zoom: bool) -> str:
    svg = inline_svg(
        lambda axes: draw_passivity(axes, points),
        name=name,
        label="Smallest eigenvalue of the Hermitian part of -Y over frequency.",
        size=(7.4, 3.6),
        zoom=zoom,
    )
    words = bullets(f"{one.op}: {passivity_words(one)}" for one in points)
    note = "Where the index of every device in a grid is positive, no oscillation can grow at that frequency."
    legend = points_legend([one.op for one in points], lines=True)
    return paragraph(note, "note") + words + legend + figure_html(svg, style="medium")


def modes_table(op: str, found: Sequence[Mode]) -> str:
    """The modes of a model on an ideal grid that matter, with bands and the states that take part."""
    lines = head(["frequency", "damping ratio", "real part (1/s)", "95 %", "states that take part"], numeric=(1, 2, 3))
    for mode in shown_modes(found):
        band = "-" if mode.real_deviation is None else f"± {number(QUANTILE * mode.real_deviation, 2)}"
        cells = [
            f'<td class="n">{data(mode.damping, percent(mode.damping) if mode.frequency else "-")}</td>',
            f'<td class="n">{data(mode.pole.real, number(mode.pole.real, 4))}</td>',
            cell(band, numeric=True),
            cell(_states(mode), wraps=True),
        ]
        lines += row(hertz(mode.frequency), cells)
    return table(f"Modes at {op}", f"{op}, on an ideal grid.", lines)


def _states(mode: Mode) -> str:
    return ", ".join(f"{name} {percent(share)}" for name, share in mode.states)
