"""Several sweeps, records and predictions in one Bode plot, or several events over time."""

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
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
    values = [load(thing) if isinstance(thing, str | PathLike) else thing for thing in things]
    if not values:
        raise IbridError("plot needs something to draw: sweeps, records, predictions, or paths")
    recordings = [value for value in values if isinstance(value, Events)]
    if len(recordings) == len(values):
        return _joined(recordings).plot(ax)
    for value in values:
        if not isinstance(value, Sweep | Record) and not hasattr(value, "admittance"):
            raise IbridError(
                "plot draws sweeps, records and predictions in one call, or events in one; found "
                f"{type(value).__name__}"
            )
    return shown(values, "plotting", "together_plot", ax, entry)


def _joined(recordings: Sequence[Events]) -> Events:
    """The records of several events, numbered by them; IbridError where their units differ."""
    first, *others = recordings
    for other in others:
        for key in ("f0_hz", "s_base_va", "v_base_v"):
            if getattr(first, key) != getattr(other, key):
                raise IbridError(
                    f"events drawn together must have the same {key}; found "
                    f"{getattr(first, key)} and {getattr(other, key)}, draw them one by one"
                )
    if not others:
        return first
    named = [
        replace(record, rest=replace(record.rest, name=f"{place}: {record.name}"))
        for place, events in enumerate(recordings, 1)
        for record in events.records
    ]
    return replace(first, records=tuple(named))
