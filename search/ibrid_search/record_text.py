"""The record of a candidate in words and numbers, as short as a prompt wants it."""

from collections.abc import Iterator, Mapping
from typing import Any

from ibrid.evaluation.record import Record
from ibrid.measurement.quantities import counted
from ibrid_search.quoting import quoted


def score_text(record: Record) -> str:
    """One candidate in a line: error, size, stability."""
    parts = [
        f"NRMSE {_number(record.nrmse)}{f' ({record.grade})' if record.grade else ''}",
        f"order {record.order}",
        counted(record.modules, "module"),
        counted(record.free_parameters, "free parameter"),
    ]
    if record.residual_modules:
        parts.append(counted(record.residual_modules, "residual module"))
    if record.holdout:
        parts.append(f"held out {_pairs(record.holdout)}")
    if not all(record.stable.values()):
        parts.append("UNSTABLE")
    return ", ".join(parts)


def record_text(record: Record, *, short: bool = False) -> str:
    """Where the error lies, size, stability, fitted parameters and what the data cannot see; `short` : errors and size."""
    return "\n".join(line for line in _lines(record, short) if line)


def _lines(record: Record, short: bool) -> Iterator[str]:
    yield f"{score_text(record)}, {counted(record.sums, 'sum')}"
    if record.noise_floor is not None:
        yield f"noise alone would leave an NRMSE of {_number(record.noise_floor)}"
    yield f"NRMSE by operating point: {_pairs(record.nrmse_by_op)}"
    yield "error by band in Hz, relative to the measurement there (share of the squared error): " + "; ".join(
        f"{band} {_number(value)} ({_percent(record.share_by_band.get(band))})"
        for band, value in record.nrmse_by_band.items()
    )
    yield f"error by entry: {_pairs(record.nrmse_by_entry)}"
    if short:
        return
    for op, bands in record.nrmse_by_part.items():
        rows = "; ".join(f"{band}: {_pairs(entries)}" for band, entries in bands.items())
        yield f"error by band and entry at {quoted(op)}: {rows}"
    yield f"stability: {_stability(record)}"
    yield f"fitted parameters: {_parameters(record)}"
    if record.at_bound:
        yield f"at a bound of their box: {', '.join(map(quoted, record.at_bound))}"
    for heading, sentences in (("what the data say", record.identifiability), ("doubtful", record.warnings)):
        for sentence in sentences:
            yield f"{heading}: {quoted(sentence)}"


def _stability(record: Record) -> str:
    found = []
    for op, stable in record.stable.items():
        worst = max(record.poles.get(op, ()), key=lambda pole: pole[0], default=None)
        if not stable and worst is not None:
            found.append(f"at {quoted(op)} a pole at {worst[0]:.3g} + {abs(worst[1]):.3g}j rad/s")
    return "UNSTABLE, " + "; ".join(found) if found else "stable at every operating point"


def _parameters(record: Record) -> str:
    """Each free number once where all operating points share it."""
    names = dict.fromkeys(name for values in record.parameters.values() for name in values)
    parts = []
    for name in names:
        values = [values[name] for values in record.parameters.values() if name in values]
        same = all(value == values[0] for value in values)
        parts.append(f"{quoted(name)} {_number(values[0]) if same else ' / '.join(map(_number, values))}")
    return ", ".join(parts) or "none"


def _pairs(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{quoted(name)} {_number(value)}" for name, value in values.items())


def _number(value: float | None) -> str:
    return "no data" if value is None else f"{value:.3g}"


def _percent(value: float | None) -> str:
    return "no data" if value is None else f"{100 * value:.0f} %"
