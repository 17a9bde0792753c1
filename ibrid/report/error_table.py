"""Where the error lies, as tables shaded by size: band by entry at every operating point, and the means."""

from collections.abc import Mapping

from ibrid.evaluation.record import Record
from ibrid.measurement.sweep import ENTRIES
from ibrid.report.markup import cell, error_cell, escape, head, row, table
from ibrid.report.numbers import percent


def error_tables(record: Record) -> str:
    """Both tables; "" without a fit."""
    if not record.nrmse_by_part:
        return ""
    means = f"<div>{_by_point(record)}{_by_band(record)}</div>"
    return f'<div class="beside">{_by_part(record)}{means}</div>'


def _by_point(record: Record) -> str:
    rows = [row(op, [error_cell(value), cell("fitted")]) for op, value in record.nrmse_by_op.items()]
    rows += [
        row(op, [error_cell(value), cell("held out: predicted, not fitted")]) for op, value in record.holdout.items()
    ]
    rows.append(row("mean of the fitted", [error_cell(record.nrmse), cell("")]))
    inner = head(["operating point", "NRMSE", "use"], numeric=(1,)) + f"<tbody>{''.join(rows)}</tbody>"
    return table("Error by operating point", "NRMSE by operating point.", inner)


def _by_part(record: Record) -> str:
    groups = [_group(op, bands) for op, bands in record.nrmse_by_part.items()]
    mean = row("all bands", [error_cell(record.nrmse_by_entry.get(entry)) for entry in ENTRIES])
    groups.append(f"<tbody>{_group_head('mean over operating points')}{mean}</tbody>")
    return table(
        "Error by band and entry",
        "Relative error of each part: the norm of the difference over the norm of the measurement in the same band and "
        "entry. The first and the last band are open-ended.",
        head(["band (Hz)", *ENTRIES], numeric=(1, 2, 3, 4)) + "".join(groups),
    )


def _group(op: str, bands: Mapping[str, Mapping[str, float | None]]) -> str:
    rows = [row(_band(band), [error_cell(found.get(entry)) for entry in ENTRIES]) for band, found in bands.items()]
    return f"<tbody>{_group_head(op)}{''.join(rows)}</tbody>"


def _group_head(text: str) -> str:
    return f'<tr><th scope="rowgroup" colspan="{len(ENTRIES) + 1}">{escape(text)}</th></tr>'


def _by_band(record: Record) -> str:
    rows = []
    for band, value in record.nrmse_by_band.items():
        share = record.share_by_band.get(band)
        rows.append(row(_band(band), [error_cell(value), cell("-" if share is None else percent(share), numeric=True)]))
    return table(
        "Error by band",
        "All entries together, mean over operating points; the last column says where the overall error comes from.",
        head(["band (Hz)", "relative error", "share of the squared error"], numeric=(1, 2))
        + f"<tbody>{''.join(rows)}</tbody>",
    )


def _band(name: str) -> str:
    return name.replace("-", "–")
