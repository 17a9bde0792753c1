"""Several sweeps, records and predictions in one Bode plot."""

from typing import Any

from ibrid.arguments.coercion import load
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.measurement.sweeps.sweep import Sweep
from ibrid.showing import shown


def plot(*things: Any, ax: Any = None, entry: str = "dd") -> Any:
    """Draw sweeps, records and predictions over each other, with a legend.

    Parameters
    ----------
    things : sweeps, records of fits, predictions; or paths and names of sweeps and records.
    ax : (magnitude, phase) axes for one entry in place of a figure of all four.
    entry : dd, dq, qd or qq, on given axes.

    Returns the figure, or `ax`. Raises IbridError for what has no frequency response.
    """
    values = [load(thing) if isinstance(thing, str) else thing for thing in things]
    if not values:
        raise IbridError("plot needs something to draw: sweeps, records, predictions, or paths")
    for value in values:
        if not isinstance(value, Sweep | Record) and not hasattr(value, "admittance"):
            raise IbridError(
                f"plot draws sweeps, records and predictions; found a {type(value).__name__}"
            )
    return shown(values, "plotting", "together_plot", ax, entry)
