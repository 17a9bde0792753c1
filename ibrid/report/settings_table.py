"""How a record was made, in words, as rows of a table."""

from collections.abc import Mapping
from typing import Any

from ibrid.evaluation.record import Record
from ibrid.report.markup import cell, row

WORDS = {
    "f0_hz": "nominal frequency (Hz)",
    "power_node": "p and q measured at",
    "frequency_hz": "measured range (Hz)",
    "fitted_points": "fitted operating points",
    "operating_points": "operating points",
    "pade_orders": "Padé order of delays",
    "restarts": "further waves of starts, at most",
    "seconds": "time limit (s)",
}


def settings_rows(record: Record) -> str:
    """Table rows: the settings, then what the starts did."""
    rows = [row(WORDS.get(name, name), [cell(_words(value), wraps=True)]) for name, value in record.settings.items()]
    rows += [row(f"starts: {name}", [cell(_words(value), wraps=True)]) for name, value in record.starts.items()]
    return f"<tbody>{''.join(rows)}</tbody>"


def _words(value: Any) -> str:
    if isinstance(value, Mapping):
        return "; ".join(f"{name}: {_words(inner)}" for name, inner in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(_words(one) for one in value) or "none"
    if isinstance(value, float):
        return f"{value:g}"
    return "none" if value is None else str(value)
