"""Residuals over frequency, along it, and between the entries."""

from collections.abc import Sequence

import numpy as np

from ibrid.analysis.models.residuals import Residuals
from ibrid.measurement.sweeps.sweep import ENTRIES
from ibrid.report.look.style import DANGER, MUTED, Axes, series


def draw_residuals(axes: Axes, residuals: Residuals) -> None:
    """Real parts as filled dots, imaginary ones as rings, in standard deviations; dashed: 95 %."""
    for op, values in residuals.values.items():
        for k, entry in enumerate(ENTRIES):
            colour, _, _ = series(k)
            first = op == next(iter(residuals.values))
            look = {"linestyle": "none", "marker": "o", "markersize": 3, "color": colour}
            label = f"$Y_{{{entry}}}$" if first else None
            axes.plot(residuals.frequency[op], values[:, k, 0], label=label, **look)
            axes.plot(residuals.frequency[op], values[:, k, 1], markerfacecolor="none", **look)
    for edge in (-1.96, 1.96):
        axes.axhline(edge, color=MUTED, linewidth=0.8, linestyle="--")
    axes.set(xscale="log", xlabel="frequency  (Hz)", ylabel="(measured - model) / sigma")


def draw_autocorrelation(axes: Axes, residuals: Residuals) -> None:
    """Of each entry along the frequencies; shaded: 95 % of white noise."""
    lags = np.arange(len(residuals.autocorrelation))
    axes.axhspan(-residuals.bound, residuals.bound, color=MUTED, alpha=0.2, linewidth=0)
    for k in range(len(ENTRIES)):
        colour, marker, _ = series(k)
        values = residuals.autocorrelation[:, k]
        axes.plot(lags, values, color=colour, marker=marker, markersize=3, linewidth=0.8)
    axes.set(xlabel="frequencies apart", ylabel="autocorrelation", ylim=(-1.05, 1.05))


def draw_cross_correlation(axes: Axes, residuals: Residuals) -> None:
    """Between the entries, with its numbers."""
    names: Sequence[str] = [f"$Y_{{{entry}}}$" for entry in ENTRIES]
    axes.imshow(residuals.cross_correlation, vmin=-1, vmax=1, cmap="coolwarm", alpha=0.6)
    for (row, column), value in np.ndenumerate(residuals.cross_correlation):
        strong = row != column and abs(value) > 2 * residuals.bound
        colour = DANGER if strong else "black"
        axes.text(column, row, f"{value:.2f}", ha="center", va="center", color=colour, fontsize=8)
    axes.set_xticks(range(len(names)), names)
    axes.set_yticks(range(len(names)), names)
    axes.grid(False)
    axes.set_title("cross correlation", fontsize=9)
