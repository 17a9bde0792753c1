"""One door for records of events."""

from pathlib import Path

from ibrid.measurement.event_csv import read_event_csv
from ibrid.measurement.events import Events


def read_events(path: str | Path, **keys: object) -> Events:
    """Read records of terminal voltage and current in time, as per unit, current out of the inverter, v at rest [v, 0].

    keys : what the file does not say about itself or says wrongly (event_csv.read_event_csv); they win over the file.

    Raises SweepError: one sentence with file and line, or record.
    """
    return read_event_csv(path, **keys)
