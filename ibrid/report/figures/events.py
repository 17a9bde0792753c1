"""Records in time: voltages above currents, d drawn whole and q dashed."""

from collections.abc import Sequence
from typing import Any

from ibrid.measurement.recordings.events import Events
from ibrid.report.look.style import series


def draw_events(pair: Sequence[Any], events: Events) -> None:
    """Draw every record on two axes, that of the voltages first."""
    for axes, letter in zip(pair, "vi", strict=True):
        for index, record in enumerate(events.records):
            for component, dashes in enumerate(("-", "--")):
                axes.plot(
                    record.time,
                    getattr(record, letter)[:, component],
                    dashes,
                    color=series(index)[0],
                    label=f"{record.name} {letter}_{'dq'[component]}",
                    linewidth=1,
                )
        axes.set_ylabel(f"{letter}  (pu)")
        axes.legend(fontsize=8)
    pair[-1].set_xlabel("time  (s)")
