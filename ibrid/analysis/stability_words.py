"""Stability in a grid, in sentences: the answer, and where it is less sure than it looks."""

from collections.abc import Sequence

from ibrid.analysis.critical import CriticalRatio
from ibrid.analysis.grid import MeasuredGrid
from ibrid.analysis.grid_case import GridCase
from ibrid.analysis.modes import Mode
from ibrid.measurement.quantities import hertz, span

#: Relative width up to which a 95 % interval is not worth a word.
TIGHT = 1e-3


def sentence(op: str, cases: Sequence[GridCase], critical: Sequence[CriticalRatio]) -> str:
    """What stability at an operating point comes to."""
    stable = [case.stable for case in cases]
    first, last = cases[0].grid, cases[-1].grid
    if isinstance(first, MeasuredGrid) or isinstance(last, MeasuredGrid) or len(cases) == 1:
        where = f"on {first.name}" if isinstance(first, MeasuredGrid) else f"at SCR {first.scr:.4g}"
        by = ", by the Nyquist count alone" if isinstance(first, MeasuredGrid) else ""
        slim = f", {' and '.join(cases[0].slim)} at {_where(cases[0])}" if cases[0].grade == "barely stable" else ""
        return f"{op}: {graded(cases[0].grade)} {where}{by}{slim}"
    if not critical:
        word = "stable" if all(stable) else "UNSTABLE"
        return f"{op}: {word} on every grid from SCR {first.scr:.4g} to {last.scr:.4g}{_barely(cases)}"
    parts = []
    for found in critical:
        band = ""
        if found.interval is not None and found.interval[1] > found.interval[0] * (1 + TIGHT):
            band = f" (95 % {found.interval[0]:.4g} to {found.interval[1]:.4g})"
        kind = "without oscillation" if found.mode.frequency == 0 else f"at {hertz(found.mode.frequency)}"
        names = " and ".join(name for name, _ in found.mode.states[:2])
        parts.append(f"unstable {found.unstable} SCR {found.scr:.4g}{band}, {kind} ({names})")
    return f"{op}: {'; '.join(parts)}{_barely(cases)}"


def graded(grade: str) -> str:
    """The word for a grade that a reader cannot pass over."""
    return "UNSTABLE" if grade == "unstable" else grade


def _barely(cases: Sequence[GridCase]) -> str:
    """Where it is barely stable, and the worst of it."""
    found = [case for case in cases if case.grade == "barely stable"]
    if not found:
        return ""
    worst = min(found, key=lambda case: case.nyquist.vector_margin)
    listed = ", ".join(f"{case.grid.scr:.4g}" for case in found[:4] if not isinstance(case.grid, MeasuredGrid))
    more = f" and {len(found) - 4} more" if len(found) > 4 else ""
    return f"; barely stable at SCR {listed}{more}, at worst {' and '.join(worst.slim)} at {_where(worst)}"


def _where(case: GridCase) -> str:
    return hertz(case.nyquist.vector_margin_hz)


def unstable_warning(op: str, worst: Mode, number: int, *, measured: bool) -> str:
    """What it means that the identified model is unstable by itself; `measured` : the data are from this point."""
    doubt = (
        "; a device that was measured on a stiff grid at this point was stable, so that this model cannot be right"
        if measured
        else ""
    )
    return (
        f"the identified model is unstable by itself at {op}, on an ideal grid: {number} {'pole' if number == 1 else 'poles'}, "
        f"up to {worst.pole.real:+.3g} rad/s at {hertz(worst.frequency)}; the Nyquist count takes them in, and "
        f"a grid on which it is stable must hold it{doubt}"
    )


def case_warnings(cases: Sequence[GridCase], highest: float) -> list[str]:
    """Where the answers on grids are less sure than they look; `highest` measured frequency in Hz."""
    found: list[str] = []
    first = [one.modes[0] for one in cases if one.modes]
    beyond = [one for one in first if not one.stable and one.frequency > highest]
    if beyond:
        found.append(
            f"an unstable mode at {hertz(beyond[0].frequency)} lies above the highest measured frequency, {hertz(highest)}: "
            "the model is an extrapolation there"
        )
    differing = [one for one in cases if one.modes is not None and one.stable != one.nyquist.stable]
    if differing:
        found.append(
            f"poles and Nyquist disagree on {len(differing)} of {len(cases)} grids: near a critical ratio, or because the poles "
            "take delays as Pade forms"
        )
    for one in cases:
        if isinstance(one.grid, MeasuredGrid):
            found += one.grid.warnings
            low, high = one.grid.frequency[0], one.grid.frequency[-1]
            found.append(
                f"the grid is known at {len(one.grid.frequency)} frequencies from {span(low, high)}: a resonance between "
                "two of them is not seen, and beyond them the grid is taken to go on as a series R and L"
            )
        if not one.nyquist.certain:
            found.append(
                "a Nyquist locus does not end on the real axis, so that its count is a guess: is a pole of the model at zero?"
            )
    return found
