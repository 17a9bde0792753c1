"""The bands of the paper as a measurement has them: cut to the frequencies that were measured,
since the first and the last one are open-ended.
"""

from ibrid.evaluation.record import Record
from ibrid.fit.objective import BAND_NAMES


def measured_band(record: Record, band: str) -> tuple[float, float]:
    """Ends in Hz of a band ("500-2000") within what the record's fit was given; those of its name
    where nothing was measured in it, or nothing is known of that.
    """
    low, high = map(float, band.split("-"))
    measured = record.settings.get("frequency_hz")
    if not measured:
        return low, high
    lowest, highest = measured
    below = lowest if band == BAND_NAMES[0] else max(low, lowest)
    above = highest if band == BAND_NAMES[-1] else min(high, highest)
    return (below, above) if below <= above else (low, high)


def band_in_hz(record: Record, band: str) -> str:
    """The same in a table whose head says the unit: 500-1000; one number where both ends are."""
    low, high = (f"{end:.4g}" for end in measured_band(record, band))
    return low if low == high else f"{low}-{high}"
