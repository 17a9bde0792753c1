"""The fitted parameters as a table: value, unit, 95 % interval, box, and what is at a bound or not visible."""

from itertools import groupby

from ibrid.evaluation.record import Record
from ibrid.report.markup import cell, escape, head, table, value_cell
from ibrid.report.numbers import number
from ibrid.report.parameter_rows import SHARED, ParameterRow, parameter_rows

#: Relative change of a value above which a twin counts as different there.
CHANGED = 1e-3


def parameter_html(record: Record) -> str:
    """The table, or a sentence where nothing was free."""
    rows = parameter_rows(record)
    if not rows:
        return "<p>The program has no free parameters.</p>"
    shared = all(row.where == SHARED for row in rows) or len(record.parameters) == 1
    columns = [
        "name",
        "meaning",
        *([] if shared else ["operating point"]),
        "value",
        "unit",
        "",
        "95 % interval",
        "box",
        "",
    ]
    at = columns.index("value")
    body = "".join(_group(list(group), shared) for _, group in groupby(rows, key=lambda row: row.name))
    caption = (
        "One value for all operating points." if shared else "Values that differ have a line for each operating point."
    )
    return table("Parameters", caption, head(columns, numeric=(at,)) + f"<tbody>{body}</tbody>")


def _group(rows: list[ParameterRow], shared: bool) -> str:
    span = f' rowspan="{len(rows)}"' if len(rows) > 1 else ""
    name = f'<th scope="row"{span}><code>{escape(rows[0].name)}</code></th>'
    name += f'<td class="text"{span}>{escape(rows[0].meaning)}</td>'
    lines = [f"<tr>{name if index == 0 else ''}{_line(row, shared)}</tr>" for index, row in enumerate(rows)]
    return "".join(lines)


def _line(row: ParameterRow, shared: bool) -> str:
    ends = "" if row.ends is None else f"{number(row.ends[0], 8)} to {number(row.ends[1], 8)}"
    where = "" if shared else cell("all operating points" if row.where == SHARED else row.where)
    interval = escape(row.interval.replace("+-", "±"))
    seen = (
        f'<td title="{escape(ends)}">{interval}</td>'
        if row.ends is not None
        else f'<td><em class="bad">{interval}</em></td>'
    )
    bound = '<td><strong class="bad">at bound</strong></td>' if row.at_bound else "<td></td>"
    readable = row.readable.replace(" us", " µs").replace(" deg", "°")
    return where + value_cell(row.value) + cell(row.unit) + cell(readable) + seen + cell(row.box_words) + bound


def twins_table(record: Record) -> str:
    """Other values that fit as well, beside those that are reported; "" without twins of a shared fit."""
    if not record.twins or record.settings.get("parameters") != "shared":
        return ""  # per operating point, a twin does not say where it belongs; the sentences do
    reported = next(iter(record.parameters.values()))
    moved = [
        name
        for name, value in reported.items()
        if any(abs(twin.get(name, value) - value) > CHANGED * abs(value) for twin in record.twins)
    ]
    rows = [
        f'<tr><th scope="row"><code>{escape(name)}</code></th>'
        f"{value_cell(reported[name])}{''.join(value_cell(twin.get(name)) for twin in record.twins)}</tr>"
        for name in moved
    ]
    names = ["name", "reported", *(f"twin {count}" for count in range(1, len(record.twins) + 1))]
    inner = head(names, numeric=range(1, len(names))) + f"<tbody>{''.join(rows)}</tbody>"
    return table("Twins", "Values that differ between solutions that fit equally well.", inner)
