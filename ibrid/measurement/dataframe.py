"""A sweep or events as a pandas DataFrame: the rows of its file."""

import io
from typing import Any

from ibrid.errors import SweepError
from ibrid.measurement.formats.csv_file import sweep_csv
from ibrid.measurement.formats.event_csv import event_csv
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import Sweep

_ATTRIBUTES = ("f0_hz", "power_node", "s_base_va", "v_base_v", "sampling_hz", "solver", "window")


def dataframe(data: Sweep | Events) -> Any:
    """See `Sweep.to_dataframe`."""
    try:
        import pandas
    except ImportError:
        what = f"the {type(data).__name__.lower()}"
        raise SweepError(
            f"a DataFrame is made by pandas; pip install pandas, or write {what} to a CSV file."
        ) from None
    text = event_csv(data) if isinstance(data, Events) else sweep_csv(data)
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    frame = pandas.read_csv(
        io.StringIO("\n".join(lines)), engine="python"
    )  # exact to the last digit
    said = {name: getattr(data, name, None) for name in _ATTRIBUTES}
    frame.attrs.update({name: value for name, value in said.items() if value is not None})
    return frame
