"""Legends of operating points and of models: colour, marker and dashes as in the figures."""

from collections.abc import Sequence
from html import escape

from ibrid.report.style import DASHES, MARKERS, SERIES

_SHAPES = {
    "o": '<circle cx="17" cy="7" r="4"/>',
    "s": '<rect x="13" y="3" width="8" height="8"/>',
    "^": '<path d="M17 2.5l4.6 8h-9.2z"/>',
    "D": '<path d="M17 2l5 5-5 5-5-5z"/>',
    "v": '<path d="M17 11.5l-4.6-8h9.2z"/>',
    "P": '<path d="M15.5 2.5h3v3h3v3h-3v3h-3v-3h-3v-3h3z"/>',
}


def points_legend(names: Sequence[str], *, lines: bool) -> str:
    """An entry for each operating point, with its line style where the figures have lines."""
    return f'<ul class="legend">{"".join(_entry(index, name, lines) for index, name in enumerate(names))}</ul>'


def models_legend(models: Sequence[tuple[str, int]], measured: int | None) -> str:
    """A line for each model, (name, number of its colour); before them a dot for the measurement in its own colour."""
    dots = [] if measured is None else [_drawn(measured, _SHAPES["o"], "measured")]
    return f'<ul class="legend">{"".join(dots + [_drawn(index, _line(index), name) for name, index in models])}</ul>'


def _entry(index: int, name: str, lines: bool) -> str:
    turn = index % len(SERIES)
    return _drawn(turn, (_line(turn) if lines else "") + _SHAPES[MARKERS[turn]], name)


def _line(turn: int) -> str:
    dashes = DASHES[turn]
    pattern = (
        "" if isinstance(dashes, str) else f' stroke-dasharray="{" ".join(f"{1.5 * one:g}" for one in dashes[1])}"'
    )
    return f'<path d="M0 7h34" stroke-width="2"{pattern}/>'


def _drawn(turn: int, shape: str, name: str) -> str:
    drawing = f'<g fill="none" stroke="var(--series-{turn})" stroke-width="1.6">{shape}</g>'
    return f'<li><svg width="34" height="14" viewBox="0 0 34 14" aria-hidden="true">{drawing}</svg>{escape(name)}</li>'
