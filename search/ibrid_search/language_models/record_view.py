"""The record of a candidate in words and numbers: as short as a prompt wants it, and as an agent
reads it.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.fit.objective import BAND_NAMES, band_index
from ibrid.gap.ports.port_map import PortFit
from ibrid.measurement.sweeps.amplitudes import evenly
from ibrid.measurement.sweeps.sweep import ENTRIES, PointSweep, Sweep
from ibrid.report.facts.parameter_rows import parameter_rows
from ibrid.report.facts.verdict import graded, verdict
from ibrid.report.look.numbers import number
from ibrid.writing import PlainData
from ibrid_search.language_models.quoting import digits, quoted

#: Parts of the error and single frequencies that are shown, and frequencies of a part that was
#: asked for.
WORST_PARTS, WORST_FREQUENCIES, OF_A_PART = 8, 6, 16
#: Frequencies of a transfer that are shown, and standard errors, as a part of it, beyond which it
#: says nothing.
OF_A_TRANSFER, USELESS = 5, 0.5


def summary(record: Record) -> PlainData:
    """One candidate in a list: error, size, stability."""
    return {
        "grade": graded(record),
        "nrmse": record.nrmse,
        "order": record.order,
        "modules": record.modules,
        "residual_modules": record.residual_modules,
        "free_parameters": record.free_parameters,
        "stable": all(record.stable.values()),
        **({"holdout": record.holdout} if record.holdout else {}),
    }


def record_view(
    record: Record,
    sweep: Sweep,
    *,
    op: str | None = None,
    band: str | None = None,
    entry: str | None = None,
) -> PlainData:
    """Everything of a fitted record that helps to decide on the next edit.

    op : name of an operating point, band : such as "5-50" (Hz), entry : dd, dq, qd or qq: which
    part of the error is asked for; None for all.

    `share` of a part : its squared error, each operating point relative to its own measurement,
    over the whole squared error; all shares add up to 1. `error` : relative to the measured norm of
    the same part. Frequencies stand in their order: those of a part that is asked for, else the
    worst. `left_out` says how much there is beside what is shown.

    Raises IbridError for a part that the data lack.
    """
    asked = {"op": op, "band": band, "entry": entry}
    wanted = {key: value for key, value in asked.items() if value is not None}
    _require(wanted, record)
    cells = list(_cells(record, sweep))
    whole = sum(cell["squared"] for cell in cells) or 1.0
    inside = (cell for cell in cells if all(cell[key] == value for key, value in wanted.items()))
    chosen = sorted(inside, key=lambda cell: -cell["squared"])
    parts, most = _parts(chosen, whole), OF_A_PART if wanted else WORST_FREQUENCIES
    name = "frequencies" if wanted else "worst_frequencies"
    left = {
        what: f"{total - kept} of {total}"
        for what, total, kept in (
            ("worst_parts", len(parts), WORST_PARTS),
            (name, len(chosen), most),
        )
        if total > kept
    }
    return {
        "verdict": verdict(record),
        **summary(record),
        "nrmse_by_op": record.nrmse_by_op,
        "nrmse_by_band_hz": record.nrmse_by_band,
        "nrmse_by_entry": record.nrmse_by_entry,
        "worst_parts": parts[:WORST_PARTS],
        name: [
            _frequency(cell, whole)
            for cell in sorted(chosen[:most], key=lambda cell: (cell["hz"], cell["op"]))
        ],
        "parameters": dict(map(_parameter, parameter_rows(record))),
        **{
            name: found
            for name, found in (
                ("unstable_at", [op for op, stable in record.stable.items() if not stable]),
                ("at_bound", record.at_bound),
                ("identifiability", record.identifiability),
                ("warnings", record.warnings),
                ("left_out", left),
            )
            if found
        },
    }


def _require(wanted: Mapping[str, str], record: Record) -> None:
    there = {
        "op": ("operating point", tuple(record.nrmse_by_op)),
        "band": ("band", BAND_NAMES),
        "entry": ("entry", tuple(ENTRIES)),
    }
    for key, value in wanted.items():
        what, known = there[key]
        if value not in known:
            raise IbridError(
                f"the fitted data have no {what} {value[:60]!r}; {near(value[:60], known)}"
            )


def _cells(record: Record, sweep: Sweep) -> Iterator[dict[str, Any]]:
    """One for each operating point, frequency and entry."""
    for op in record.nrmse_by_op:
        point: PointSweep = sweep.point(op)
        model = record.response(op, point.frequency)
        norm = float(np.linalg.norm(point.admittance)) ** 2
        for k, band in enumerate(band_index(point.frequency)):
            for entry, place in ENTRIES.items():
                measured, modelled = complex(point.admittance[k][place]), complex(model[k][place])
                yield {
                    "op": op,
                    "band": BAND_NAMES[band],
                    "entry": entry,
                    "hz": float(point.frequency[k]),
                    "measured": measured,
                    "model": modelled,
                    "squared": abs(modelled - measured) ** 2 / norm,
                    "size": abs(measured) ** 2 / norm,
                }


def _parts(cells: list[dict[str, Any]], whole: float) -> list[dict[str, Any]]:
    sums: dict[tuple[str, str, str], list[float]] = {}
    for cell in cells:
        both = sums.setdefault((cell["op"], cell["band"], cell["entry"]), [0.0, 0.0])
        both[0] += cell["squared"]
        both[1] += cell["size"]
    ranked = sorted(sums.items(), key=lambda one: -one[1][0])
    return [
        {
            "op": op,
            "band_hz": band,
            "entry": entry,
            "share": squared / whole,
            "error": (squared / size) ** 0.5 if size > 0 else None,
        }
        for (op, band, entry), (squared, size) in ranked
    ]


def _frequency(cell: Mapping[str, Any], whole: float) -> PlainData:
    return {
        "op": cell["op"],
        "hz": cell["hz"],
        "entry": cell["entry"],
        "share": cell["squared"] / whole,
        "measured": polar(cell["measured"]),
        "model": polar(cell["model"]),
    }


def polar(value: complex) -> str:
    """Size and angle, in words."""
    return f"{abs(value):.4g} at {np.degrees(np.angle(value)):.1f} deg"


def port_view(fit: PortFit) -> PlainData:
    """A port of the port map in plain data: what is left over in sigmas squared, and the transfer
    where the data see it.
    """
    seen = np.flatnonzero(fit.deviation < USELESS * np.abs(fit.transfer))
    chosen = seen[evenly(seen.size, OF_A_TRANSFER)]
    rows = {f"{fit.frequency[k]:.3g} Hz": polar(complex(fit.transfer[k])) for k in chosen}
    return {
        "port": fit.port.name,
        "place": fit.port.words,
        "chi2_per_number": fit.chi2_per_dof,
        "transfer": rows,
    }


def _parameter(row: Any) -> tuple[str, str]:
    """Name, and value with unit and interval in words."""
    name = row.name if row.where == "all" else f"{row.name} at {row.where}"
    unit = "" if row.unit == "1" else f" {row.unit}"
    return name, f"{number(row.value)}{unit}, {row.interval or 'open'}" + (
        f", at a bound of {row.box_words}" if row.at_bound else ""
    )


def record_facts(record: Record, *, short: bool = False) -> dict[str, Any]:
    """What the template `record.md` tells: where the error lies, size, stability, fitted parameters
    and what the data cannot see;
    `short` : errors and size.
    """
    shares = {
        band: "no data" if one is None else f"{100 * one:.0f} %"
        for band, one in record.share_by_band.items()
    }
    bands = (
        f"{band} {digits(value)} ({shares.get(band, 'no data')})"
        for band, value in record.nrmse_by_band.items()
    )
    return {
        "record": record,
        "short": short,
        "bands": "; ".join(bands),
        "stability": _stability(record),
        "parameters": _parameters(record),
    }


def _stability(record: Record) -> str:
    unstable = []
    for op, stable in record.stable.items():
        worst = max(record.poles.get(op, ()), key=lambda pole: pole[0], default=None)
        if not stable and worst is not None:
            unstable.append(
                f"at {quoted(op)} a pole at {worst[0]:.3g} + {abs(worst[1]):.3g}j rad/s"
            )
    return "UNSTABLE, " + "; ".join(unstable) if unstable else "stable at every operating point"


def _parameters(record: Record) -> str:
    """Each free number once where all operating points share it."""
    names = dict.fromkeys(name for values in record.parameters.values() for name in values)
    parts = []
    for name in names:
        values = [values[name] for values in record.parameters.values() if name in values]
        same = all(value == values[0] for value in values)
        parts.append(
            f"{quoted(name)} {digits(values[0]) if same else ' / '.join(map(digits, values))}"
        )
    return ", ".join(parts) or "none"
