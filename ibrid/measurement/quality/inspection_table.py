"""Inspections as plain text: of a sweep a column for each operating point, of events a block for
each record; then verdicts.
"""

import textwrap
from collections.abc import Iterator, Sequence
from itertools import zip_longest

from ibrid.border import takes_kinds
from ibrid.foreign_text import controls_shown
from ibrid.measurement.quality.event_inspection import EventsInspection, RecordInspection
from ibrid.measurement.quality.inspect import Inspection, PointInspection
from ibrid.measurement.sweeps.quantities import band, counted, hertz, percent, set_point
from ibrid.writing import aligned

_WIDTH = 100
_PER_BLOCK = 3


@takes_kinds
@controls_shown
def format_inspection(inspection: Inspection) -> str:
    """The inspection as text of about 100 columns."""
    lines = [f"sweep    {inspection.source or '(no file)'}", f"system   {_system(inspection)}"]
    points = inspection.points
    for start in range(0, len(points), _PER_BLOCK):
        rows = _point_rows(points[start : start + _PER_BLOCK], inspection.f0_hz)
        lines += ["", aligned([label, *cells] for label, cells in rows)]
    lines += ["", *paragraph("conventions: ", inspection.conventions.sentence)]
    return "\n".join([*lines, *_mind(inspection.warnings)]) + "\n"


def _mind(warnings: Sequence[str]) -> list[str]:
    lines = ["", "mind:"] if warnings else []
    for warning in warnings:
        lines += paragraph("  - ", warning)
    return lines


def _base(inspection: Inspection | EventsInspection) -> list[str]:
    known = inspection.s_base_va and inspection.v_base_v
    return [f"base {inspection.s_base_va:g} VA, {inspection.v_base_v:g} V"] if known else []


def _system(inspection: Inspection) -> str:
    words = [
        f"{inspection.f0_hz:g} Hz",
        counted(len(inspection.points), "operating point"),
        f"p and q at the {'PCC' if inspection.power_node == 'pcc' else 'filter capacitor'}",
    ]
    words += _base(inspection)
    if inspection.sampling_hz:
        words.append(f"sampled at {hertz(inspection.sampling_hz)}")
    return ", ".join(words)


def _point_rows(
    points: tuple[PointInspection, ...], f0_hz: float
) -> Iterator[tuple[str, list[str]]]:
    """A label, and a cell for each operating point."""
    yield "", [point.op.name for point in points]
    yield "p, q, v", [", ".join(map(set_point, point.op.pqv)) for point in points]
    yield "points", [f"{point.points}, {point.points_per_decade:.0f} a decade" for point in points]
    yield "range", [band(point.lowest, point.highest) for point in points]
    yield (
        "repeats",
        ["one run" if point.repeats == 1 else f"{point.repeats} runs" for point in points],
    )
    if any(len(point.amplitudes) > 1 for point in points):
        sizes = [", ".join(f"{one:g}" for one in point.amplitudes) for point in points]
        yield "amplitudes (shown: the smallest)", sizes
    yield "noise, rms of the matrix", [_noise(point) for point in points]
    if any(point.noise is not None for point in points):
        yield "  known from", [point.noise_source for point in points]
        yield "  worst", [_worst(point) for point in points]
    conditions = [f"at most {point.condition:.3g}, {hertz(point.condition_at)}" for point in points]
    least = [
        f"{point.smallest_eigenvalue:+.3g}, {hertz(point.smallest_eigenvalue_at)}"
        for point in points
    ]
    yield "condition number of Y", conditions
    yield "passivity, least eigenvalue of -Y", least
    yield from _band_rows(points)
    yield "points in the usual range of", ["" for _ in points]
    for k, loop in enumerate(points[0].loops):
        yield (
            f"  {loop.loop}, {_loop_range(loop.low, loop.high)}",
            [_loop(point, k) for point in points],
        )
    peaks = [
        [f"{hertz(one.frequency)} ({one.points})" for one in point.resonances[:3]]
        for point in points
    ]
    yield "peaks (points across)", [", ".join(some) or "none" for some in peaks]
    yield from _sequence_rows(points, f0_hz)
    if any(point.above_half_sampling is not None for point in points):
        yield "above half the sampling rate", [f"{point.above_half_sampling}" for point in points]
    if any(point.lines for point in points):
        yield "on multiples of f0", [f"{len(point.lines)}" for point in points]


def _noise(point: PointInspection) -> str:
    if point.noise is None or point.noise_db is None:
        return "unknown"
    return f"{percent(point.noise)} ({point.noise_db:.0f} dB)"


def _worst(point: PointInspection) -> str:
    if point.noise_worst is None or point.noise_worst_at is None:
        return "-"
    return f"{percent(point.noise_worst)}, {hertz(point.noise_worst_at)}"


def _band_rows(points: tuple[PointInspection, ...]) -> Iterator[tuple[str, list[str]]]:
    """Bands in which the inverter is active, one below the other; at most five."""
    bands = [[band(*edges) for edges in point.active_bands] or ["nowhere"] for point in points]
    shown = [
        texts if len(texts) <= 5 else [*texts[:4], f"and {len(texts) - 4} more"] for texts in bands
    ]
    for k, cells in enumerate(zip_longest(*shown, fillvalue="")):
        yield "" if k else "  negative: inverter active at", list(cells)


def _loop_range(low: float, high: float) -> str:
    if low == 0:
        return f"below {hertz(high)}"
    return f"above {hertz(low)}" if high == float("inf") else band(low, high)


def _loop(point: PointInspection, k: int) -> str:
    loop = point.loops[k]
    return f"{loop.points or 'none'}{' (few)' if loop.verdict == 'few' else ''}"


def _sequence_rows(
    points: tuple[PointInspection, ...], f0_hz: float
) -> Iterator[tuple[str, list[str]]]:
    """What each sequence sees: the impedance at multiples of f0 in dq over that beside it, and the
    resistance.
    """
    for n in sorted({n for point in points for n in point.rises}):
        cells = [
            ", ".join(f"{one:.2g}" for one in point.rises[n]) if n in point.rises else "-"
            for point in points
        ]
        yield f"|Z| at {n * f0_hz:g} Hz over beside it, + and - sequence", cells
    if any(point.resistance for point in points):
        cells = [
            "-" if point.resistance is None else "{:.3g}, {:.3g}".format(*point.resistance)
            for point in points
        ]
        yield "resistance along and across the current", cells


def paragraph(start: str, text: str) -> list[str]:
    """Lines of a sentence behind its mark, those after the first indented like it."""
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=start,
        subsequent_indent=" " * len(start),
        break_on_hyphens=False,
    )


@controls_shown
def format_events_inspection(inspection: EventsInspection) -> str:
    """The inspection as text of about 100 columns."""
    system = [
        f"{inspection.f0_hz:g} Hz",
        counted(len(inspection.records), "record"),
        *_base(inspection),
    ]
    lines = [f"events   {inspection.source or '(no file)'}", f"system   {', '.join(system)}"]
    for record in inspection.records:
        lines += ["", record.rest.name, aligned(_rows(record), "  ")]
        for words, sentences in (("can tell", record.tells), ("cannot tell", record.cannot_tell)):
            for sentence in sentences:
                lines += paragraph(f"  {words}: ", sentence)
    return "\n".join([*lines, *_mind(inspection.warnings)]) + "\n"


def _rows(record: RecordInspection) -> Iterator[tuple[str, str]]:
    rest = record.rest
    yield "event", record.event
    yield (
        "rest, at the PCC",
        f"p {rest.p:.4g}, q {rest.q:.4g}, v {rest.v:.4g}, up to {record.rest_end:.4g} s",
    )
    if record.offset_hz:
        yield "frequency at rest", f"{record.offset_hz:+.4f} Hz beside the nominal one, turned out"
    for name, (low, high) in record.windows.items():
        yield name, f"{low:.4g} to {high:.4g} s"
    yield "voltage, means of half cycles", f"{record.lowest:.3g} to {record.highest:.3g}"
    yield "largest current", f"{record.largest_current:.3g}"
    yield (
        "samples",
        f"{record.samples}, {'' if record.even else 'unevenly about '}{hertz(record.rate_hz)}",
    )
    if record.window is not None:
        yield "window of the estimator", f"{record.window}, up to {hertz(record.bandwidth_hz)}"
    for what, noise, source in (
        ("current", record.noise, record.noise_from),
        ("voltage", record.voltage_noise, "rest"),
    ):
        yield (
            f"noise of the {what}",
            f"{noise:.2g}, from {source}" if noise > 1e-9 else "not seen at rest",
        )
    zero = "" if record.zero is None else f", zero {percent(record.zero / rest.v)} at most"
    if record.window is None:
        yield (
            "unbalance of the voltage",
            f"negative sequence {percent(record.negative / rest.v)}{zero}",
        )
    for remark in record.remarks:
        yield "on reading", remark
