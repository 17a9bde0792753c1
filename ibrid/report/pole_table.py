"""Stability and the least damped modes of every operating point as a table."""

from ibrid.evaluation.record import Record
from ibrid.measurement.quantities import hertz
from ibrid.report.markup import cell, data, escape, head, paragraph, table
from ibrid.report.modes import measured_up_to, modes, slowest
from ibrid.report.numbers import number, percent

#: Modes that are listed for each operating point.
LISTED = 5


def pole_tables(record: Record) -> str:
    """Stability, then the modes within the measured range."""
    highest = measured_up_to(record)
    caption = f"The {LISTED} least damped modes up to the highest measured frequency, {hertz(highest)}."
    inner = head(["operating point", "frequency", "damping ratio", "real part (1/s)"], numeric=(1, 2, 3))
    inner += "".join(_group(record, op, highest) for op in record.poles)
    return _stability(record) + table("Least damped modes", caption, inner)


def _stability(record: Record) -> str:
    rows = []
    for op, poles in record.poles.items():
        fine = record.stable.get(op, False)
        word = f'<td class="{"good" if fine else "bad"}">{"stable" if fine else "UNSTABLE"}</td>'
        rows.append(
            f'<tr><th scope="row">{escape(op)}</th>{word}{cell(number(slowest(poles), 3), numeric=True)}'
            f"{cell(str(len(poles)), numeric=True)}</tr>"
        )
    inner = head(["operating point", "at an ideal grid", "largest real part (1/s)", "poles"], numeric=(2, 3))
    orders = record.settings.get("pade_orders") or {}
    pade = "; ".join(f"{name} of order {order}" for name, order in orders.items())
    note = paragraph(f"Delays enter the poles as Padé forms: {pade}.", "note") if pade else ""
    return table("Stability", "Stability of the fitted model.", inner + f"<tbody>{''.join(rows)}</tbody>") + note


def _group(record: Record, op: str, highest: float) -> str:
    found = modes(record.poles[op], highest)[:LISTED]
    if not found:
        return f'<tbody><tr><th scope="row">{escape(op)}</th><td colspan="3">no oscillating mode</td></tr></tbody>'
    lines = []
    for index, mode in enumerate(found):
        name = f'<th scope="rowgroup" rowspan="{len(found)}">{escape(op)}</th>' if index == 0 else ""
        lines.append(
            f'<tr>{name}<td class="n">{data(mode.frequency, hertz(mode.frequency))}</td>'
            f'<td class="n">{data(mode.damping, percent(mode.damping))}</td>'
            f"{cell(number(mode.real, 4), numeric=True)}</tr>"
        )
    return f"<tbody>{''.join(lines)}</tbody>"
