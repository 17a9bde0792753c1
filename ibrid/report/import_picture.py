"""One picture at the end of an import, in which a wrong unit or sign jumps to the eye.

A sweep: |Y| of the direct and the cross entries beside the band of real filters, and the phase of
the direct ones: with the current out of the inverter an inductance lies at +90 degrees. Recordings:
the size of voltage and current, and p and q, per unit.
"""

import io
from typing import Any

import numpy as np
from matplotlib import rc_context, rcdefaults, rcParams
from matplotlib.figure import Figure

from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.report.look.style import series
from ibrid.report.plotting import on_white

#: Inductances of real filters, per unit.
FILTERS = (0.03, 0.6)
_SETTINGS: Any = {
    "axes.grid": True,
    "font.size": 9,
    "svg.hashsalt": "ibrid",
    "svg.fonttype": "none",
}


def import_picture(data: Sweep | Events, kind: str) -> bytes:
    """The picture as svg or png."""
    with rc_context():
        rcdefaults()  # the same picture whatever the reader's own figures look like
        rcParams.update(_SETTINGS)
        figure = Figure(figsize=(8, 6), layout="constrained")
        upper, lower = figure.subplots(2, sharex=True)
        if isinstance(data, Events):
            _draw_records(upper, lower, data)
        else:
            _draw_sweep(upper, lower, data)
        on_white(upper, lower)
        stream = io.BytesIO()
        figure.savefig(
            stream, format=kind, metadata={"Date": None, "Creator": None} if kind == "svg" else None
        )
    return stream.getvalue()


def _draw_sweep(magnitude: Any, phase: Any, sweep: Sweep) -> None:
    ends = np.array([[point.frequency[0], point.frequency[-1]] for point in sweep.points])
    grid = np.geomspace(
        max(ends[:, 0].min(), sweep.f0_hz), max(ends[:, 1].max(), 2 * sweep.f0_hz), 50
    )
    low, high = (sweep.f0_hz / (grid * x) for x in (FILTERS[1], FILTERS[0]))
    magnitude.fill_between(
        grid,
        low,
        high,
        color="#dfe7ef",
        label=f"filters of {FILTERS[0]:g} to {FILTERS[1]:g} per unit",
    )
    for index, point in enumerate(sweep.points):
        colour = series(index)[0]
        for (row, column), dashes in zip(
            ((0, 0), (1, 1), (0, 1), (1, 0)), ("-", "--", ":", "-."), strict=True
        ):
            name = f"{point.op.name} Y{'dq'[row]}{'dq'[column]}"
            value = point.admittance[:, row, column]
            magnitude.loglog(
                point.frequency, np.abs(value), dashes, color=colour, label=name, linewidth=1
            )
            if row == column:
                phase.semilogx(
                    point.frequency, np.angle(value, deg=True), dashes, color=colour, linewidth=1
                )
    phase.axhline(90, color="#b3261e", linewidth=0.8)
    phase.annotate(
        "an inductance, current out of the inverter",
        (ends[:, 0].min(), 94),
        fontsize=8,
        color="#b3261e",
    )
    phase.set_ylim(-190, 190)
    magnitude.set_ylabel("|Y|, per unit")
    phase.set_ylabel("phase of Ydd and Yqq, degrees")
    phase.set_xlabel("frequency in dq, Hz")
    magnitude.legend(fontsize=7)


def _draw_records(sizes: Any, powers: Any, events: Events) -> None:
    sizes.axhline(1.0, color="#b3261e", linewidth=0.8)
    for index, record in enumerate(events.records):
        colour = series(index)[0]
        v, i = (getattr(record, letter) @ np.array([1, 1j]) for letter in "vi")
        sizes.plot(record.time, np.abs(v), color=colour, label=f"{record.name} |v|", linewidth=1)
        sizes.plot(
            record.time, np.abs(i), "--", color=colour, label=f"{record.name} |i|", linewidth=1
        )
        power = v * np.conj(i)
        powers.plot(
            record.time, power.real, color=colour, label=f"{record.name} p, delivered", linewidth=1
        )
        powers.plot(
            record.time,
            power.imag,
            "--",
            color=colour,
            label=f"{record.name} q, delivered",
            linewidth=1,
        )
    sizes.set_ylabel("per unit, 1 is rated")
    powers.set_ylabel("per unit")
    powers.set_xlabel("time, s")
    for axes in (sizes, powers):
        axes.legend(fontsize=7)
