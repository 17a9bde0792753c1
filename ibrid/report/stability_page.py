"""The page of stability in a grid: the answer on top, grids, root locus, eigenloci, passivity, modes."""

from collections.abc import Sequence
from typing import Any

from ibrid.analysis.grid import SeriesRL
from ibrid.analysis.modes import QUANTILE, Mode
from ibrid.analysis.stability import PointStability, Stability
from ibrid.analysis.stability_words import graded
from ibrid.report.figure import inline_svg
from ibrid.report.numbers import interval, number
from ibrid.report.prediction_text import shown_modes
from ibrid.report.stability_figures import draw_eigenloci, draw_locus, draw_passivity, shown_cases
from ibrid.report.stability_text import CASE_HEAD, case_cells, grid_name, passivity_words
from ibrid.report.template import page


def stability_page(study: Stability, source: str = "") -> str:
    """The page as text; `source` : the record's name."""
    above = "Identified inverter model" + (f": {source}" if source else "")
    return page("stability.html", stability_facts(study) | {"above": above, "source": source})


def stability_facts(study: Stability, name: str = "", *, zoom: bool = True) -> dict[str, Any]:
    """What stability.html is filled with. `name` : goes before those of the figures; `zoom` : False where no script runs."""
    points = study.points
    return {
        "study": study,
        "critical": [
            (point.op, crossing, "-" if crossing.interval is None else interval(crossing.scr, crossing.interval, None))
            for point in points
            for crossing in point.critical
        ],
        "grid_word": "SCR" if _ratios(points[0]) else "grid",
        "case_head": list(CASE_HEAD),
        "grids": [
            (point.op, [(grid_name(case), case_cells(case, float(point.frequency[-1]))) for case in point.cases])
            for point in points
        ],
        "locus": [
            (point.op, _locus(f"{name}locus-{index}", point))
            for index, point in enumerate(points)
            if any(other.cases[0].modes is not None for other in points)
        ],
        "eigenloci": [
            (point.op, _line_names(point), _eigenloci(f"{name}loci-{index}", point, zoom))
            for index, point in enumerate(points)
        ],
        "passivity": [(point.op, passivity_words(point)) for point in points],
        "passivity_svg": inline_svg(
            lambda axes: draw_passivity(axes, points),
            name=f"{name}passivity",
            label="Smallest eigenvalue of the Hermitian part of -Y over frequency.",
            size=(7.4, 3.6),
            zoom=zoom,
        ),
        "ideal": [(point.op, mode_rows(point.ideal)) for point in points],
        "warnings": list(dict.fromkeys(words for point in points for words in point.warnings)),
    }


def mode_rows(modes: Sequence[Mode]) -> list[tuple[Mode, str]]:
    """The modes of a model that matter, each with the 95 % band of its real part."""
    return [
        (mode, "-" if mode.real_deviation is None else f"± {number(QUANTILE * mode.real_deviation, 2)}")
        for mode in shown_modes(modes)
    ]


def _ratios(point: PointStability) -> bool:
    """Whether the grids are named by their short-circuit ratio."""
    return isinstance(point.cases[0].grid, SeriesRL)


def _line_names(point: PointStability) -> list[str]:
    first = "SCR " if _ratios(point) else ""
    return [f"{first}{grid_name(case)}: {graded(case.grade)}" for case in shown_cases(point)]


def _locus(name: str, point: PointStability) -> str:
    label = f"Poles at {point.op} over the short-circuit ratio, real part against frequency."
    return inline_svg(lambda axes: draw_locus(axes, point), name=name, label=label, size=(5.2, 4.2))


def _eigenloci(name: str, point: PointStability, zoom: bool) -> str:
    label = f"Eigenloci of Z (-Y) at {point.op}; the table gives counts and distances from -1."
    return inline_svg(lambda axes: draw_eigenloci(axes, point), name=name, label=label, size=(5.2, 5.0), zoom=zoom)
