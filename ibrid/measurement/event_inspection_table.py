"""An inspection of events as plain text: a block for each record, then what contradicts itself."""

from collections.abc import Iterator

from ibrid.measurement.event_inspection import EventsInspection, RecordInspection
from ibrid.measurement.inspection_table import paragraph
from ibrid.measurement.quantities import hertz, percent
from ibrid.writing import aligned


def format_events_inspection(inspection: EventsInspection) -> str:
    """The inspection as text of about 100 columns."""
    base = (
        f", base {inspection.s_base_va:g} VA, {inspection.v_base_v:g} V"
        if inspection.s_base_va and inspection.v_base_v
        else ""
    )
    count = len(inspection.records)
    lines = [
        f"events   {inspection.source or '(no file)'}",
        f"system   {inspection.f0_hz:g} Hz, {count} record{'' if count == 1 else 's'}{base}",
    ]
    for record in inspection.records:
        lines += ["", record.rest.name, aligned(_rows(record), "  ")]
        for words, sentences in (("can tell", record.tells), ("cannot tell", record.cannot_tell)):
            for sentence in sentences:
                lines += paragraph(f"  {words}: ", sentence)
    if inspection.warnings:
        lines += ["", "mind:"]
        for warning in inspection.warnings:
            lines += paragraph("  - ", warning)
    return "\n".join(lines) + "\n"


def _rows(record: RecordInspection) -> Iterator[tuple[str, str]]:
    rest = record.rest
    yield "event", record.event
    yield "rest, at the PCC", f"p {rest.p:.4g}, q {rest.q:.4g}, v {rest.v:.4g}, up to {record.rest_end:.4g} s"
    if record.offset_hz:
        yield "frequency at rest", f"{record.offset_hz:+.4f} Hz beside the nominal one, turned out"
    for name, (low, high) in record.windows.items():
        yield name, f"{low:.4g} to {high:.4g} s"
    yield "voltage, means of half cycles", f"{record.lowest:.3g} to {record.highest:.3g}"
    yield "largest current", f"{record.largest_current:.3g}"
    yield "samples", f"{record.samples}, {'' if record.even else 'unevenly about '}{hertz(record.rate_hz)}"
    yield (
        "noise of the current",
        f"{record.noise:.2g}, from {record.noise_from}" if record.noise > 1e-9 else "not seen at rest",
    )
    zero = "" if record.zero is None else f", zero {percent(record.zero / rest.v)} at most"
    yield "unbalance of the voltage", f"negative sequence {percent(record.negative / rest.v)}{zero}"
    for remark in record.remarks:
        yield "on reading", remark
