"""The nominal frequency of a foreign table: as it is said, and what its highest frequencies show of
it.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.conventions.frequency_base import (
    contradicting_readings,
    frequency_reading,
    other_frequency,
)
from ibrid.measurement.importing.foreign_part import Part
from ibrid.measurement.importing.import_account import Account
from ibrid.measurement.sweeps.noise import estimate_point
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep

_QUESTION = "the nominal frequency of the grid"
_OPTIONS = ("--f0-hz 50", "--f0-hz 60")


def ask_of_nominal(parts: Sequence[Part], account: Account) -> None:
    """Ask for f0 with what the highest frequencies read, where nothing says it."""
    readings = [reading for part in parts if (reading := _reading_of_part(part)) is not None]
    if not readings:
        account.ask(_QUESTION, *_OPTIONS)
        return
    hertz, doubt = min(readings, key=lambda one: one[1])
    account.ask(
        f"{_QUESTION} (the highest frequencies read {hertz:.3g} Hz +- {doubt:.1g})", *_OPTIONS
    )


def doubt_nominal(sweep: Sweep, account: Account) -> None:
    """Where every operating point shows another f0 than the file says, that is asked for; what the
    user says is only doubted.
    """
    other = other_frequency(contradicting_readings(sweep), sweep.f0_hz)
    if other is None:
        return
    usual, mean = other
    if account.said.get("f0_hz") is not None:
        account.remark(
            f"f0_hz: {sweep.f0_hz:g} as said, while the highest frequencies read {mean:.3g} Hz"
        )
        return
    words = (
        f"{_QUESTION} ({sweep.f0_hz:g} Hz stands there, the highest frequencies read {mean:.3g} Hz)"
    )
    account.ask(words, f"--f0-hz {usual:g}", f"--f0-hz {sweep.f0_hz:g}")


def _reading_of_part(part: Part) -> tuple[float, float] | None:
    """Hz and their doubt at the first operating point; None where that shows nothing.

    Unit and base don't matter.
    """
    if part.counting.frame != "dq":
        return None
    rows = np.flatnonzero((part.names == part.names[0]) & (part.frequency > 0))
    frequency, first = np.unique(part.frequency[rows], return_index=True)
    matrix = part.matrix[rows[first]]
    try:
        with np.errstate(all="ignore"):
            admittance = np.linalg.inv(matrix) if part.quantity.letter == "Z" else matrix
        point = PointSweep(OperatingPoint("point", 0.0, 0.0), frequency, admittance)
    except (SweepError, np.linalg.LinAlgError):
        return None
    reading = frequency_reading(point, estimate_point(point))
    return (reading.hertz, reading.doubt) if reading is not None and reading.sure else None
