"""What `ibrid stability` prints: the answer, a table over the grids, passivity, modes; at most 110
columns wide.
"""

from ibrid.analysis.grids.grid import SeriesRL
from ibrid.analysis.grids.stability import GridCase, PointStability, Stability
from ibrid.analysis.models.modes import least_damped
from ibrid.foreign_text import controls_shown
from ibrid.measurement.sweeps.quantities import hertz, span
from ibrid.report.look.numbers import interval, number, percent
from ibrid.report.texts.prediction_text import mode_table
from ibrid.report.texts.text import listed, table, wrapped


@controls_shown
def format_stability(found: Stability) -> str:
    """One part for each operating point."""
    return "\n\n\n".join(map(_point, found.points, found.sentences)) + "\n"


def _point(point: PointStability, sentence: str) -> str:
    rows = [
        [grid_name(case), *case_cells(case, float(point.frequency[-1]))] for case in point.cases
    ]
    name = "SCR" if isinstance(point.cases[0].grid, SeriesRL) else "grid"
    grids = table([name, *CASE_HEAD], rows, right=(0, 1, 6, 7))
    parts = [wrapped(sentence, "  "), grids, wrapped(passivity_words(point), "  ")]
    parts += [_critical(point)] if point.critical else []
    parts.append(mode_table(f"on an ideal grid at {point.op}", point.ideal))
    parts += [listed("warnings", point.warnings)] if point.warnings else []
    return "\n\n".join("\n".join(part) for part in parts)


def passivity_words(point: PointStability) -> str:
    """Where the inverter is active, in a sentence."""
    index, bands = point.passivity.smallest, point.passivity.bands
    worst = int(index.argmin())
    least = (
        f"its smallest value is {number(float(index[worst]), 3)} at "
        f"{hertz(float(point.frequency[worst]))}"
    )
    if not bands:
        return (
            "passivity index of -Y: positive from "
            f"{span(point.frequency[0], point.frequency[-1])}; {least}"
        )
    words = ", ".join(span(low, high) for low, high in bands)
    return (
        "passivity index of -Y: negative, so that the inverter can feed an oscillation, in "
        f"{words}; {least}"
    )


def case_cells(case: GridCase, highest: float) -> list[str]:
    """Verdicts, the mode that matters, and margins, without the name of the grid; `highest`
    measured frequency in Hz.
    """
    nyquist = case.nyquist
    if case.modes is None:
        poles, mode = "-", "-"
    else:
        lost = sum(1 if one.frequency == 0 else 2 for one in case.modes if not one.stable)
        poles = case.grade if case.stable else f"{lost} UNSTABLE"
        first = case.modes[0]
        mode = (
            f"{number(first.pole.real, 3)} 1/s, {hertz(first.frequency)}" if lost else _least(case)
        )
    count = "stable" if nyquist.stable else f"{nyquist.unstable_poles} UNSTABLE"
    count += "" if nyquist.certain else " ?"
    return [
        number(case.thevenin, 3),
        poles,
        count,
        mode,
        f"{number(nyquist.vector_margin, 2)} at {hertz(nyquist.vector_margin_hz)}"
        + (", beyond the data" if nyquist.vector_margin_hz > highest else ""),
        number(case.margins["gain"], 3),
        number(case.margins["phase_deg"], 2),
    ]


def _least(case: GridCase) -> str:
    found = least_damped(case.modes or ())
    return (
        f"{hertz(found[0].frequency)} at {percent(found[0].damping)}" if found else "no oscillation"
    )


CASE_HEAD = (
    "|v_Th|",
    "poles",
    "Nyquist",
    "least damped or unstable",
    "distance to -1",
    "gain",
    "phase",
)


def grid_name(case: GridCase) -> str:
    """The grid in a table: its short-circuit ratio, or its file."""
    return number(case.grid.scr, 4) if isinstance(case.grid, SeriesRL) else case.grid.name


def _critical(point: PointStability) -> list[str]:
    rows = []
    for critical in point.critical:
        band = "-" if critical.interval is None else interval(critical.scr, critical.interval, None)
        nyquist = "not found" if critical.scr_nyquist is None else number(critical.scr_nyquist, 5)
        kind = hertz(critical.mode.frequency) if critical.mode.frequency else "no oscillation"
        states = ", ".join(f"{name} {percent(share)}" for name, share in critical.mode.states)
        rows.append([number(critical.scr, 5), nyquist, band, critical.unstable, kind, states])
    head = ["critical SCR", "by Nyquist", "95 %", "unstable", "mode", "states that take part"]
    return table(head, rows, right=(0, 1))
