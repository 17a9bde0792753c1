"""Several sweeps, records and predictions in one Bode plot, or several events over time."""

from dataclasses import replace
from typing import Any

from ibrid.arguments.coercion import load
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.showing import shown


def plot(*things: Any, ax: Any = None, entry: str = "dd") -> Any:
    """Draw sweeps, records and predictions over each other, with a legend.

    Parameters
    ----------
    things : sweeps, records of fits, predictions; or paths and names of sweeps and records. Or
    records of events alone, over time.
    ax : (magnitude, phase) axes for one entry in place of a figure of all four.
    entry : dd, dq, qd or qq, on given axes.

    Returns the figure, or `ax`. Raises IbridError for what has no frequency response.
    """
    values = [load(thing) if isinstance(thing, str) else thing for thing in things]
    if not values:
        raise IbridError("plot needs something to draw: sweeps, records, predictions, or paths")
    recordings = [value for value in values if isinstance(value, Events)]
    if len(recordings) == len(values):
        named = [
            replace(record, rest=replace(record.rest, name=f"{place}: {record.name}"))
            for place, events in enumerate(recordings, 1)
            for record in events.records
        ]
        return replace(recordings[0], records=tuple(named)).plot(ax)
    for value in values:
        if not isinstance(value, Sweep | Record) and not hasattr(value, "admittance"):
            raise IbridError(
                f"plot draws sweeps, records and predictions, or events alone; found a "
                f"{type(value).__name__}"
            )
    return shown(values, "plotting", "together_plot", ax, entry)
