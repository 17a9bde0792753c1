"""Operating points that may be one: with the same steady state and other numbers, or with the same
numbers.

They are kept as they are; a copy by mistake and one operating point measured twice look the same.
"""

import numpy as np

from ibrid.errors import some
from ibrid.measurement.formats.grouping import first_near, rows_of_each
from ibrid.measurement.importing.import_account import Account
from ibrid.measurement.importing.repeated_runs import distance
from ibrid.measurement.sweeps.quantities import percent
from ibrid.measurement.sweeps.sweep import PointSweep, Sweep

#: p, q and v nearer than that are the same, per unit.
_SAME = 1e-6


def mind_alike_points(sweep: Sweep, account: Account) -> None:
    """Remark on operating points of which others have the same p, q and v, or the same numbers."""
    points = sweep.points
    numbers = [(one.frequency.tobytes(), one.admittance.tobytes()) for one in points]
    for places in rows_of_each(numbers).values():
        if len(places) > 1:
            names = some([points[place].op.name for place in places])
            account.remark(f"{names} have the same numbers throughout: is one a copy of the other?")
    powers = np.array([[one.op.p, one.op.q, one.op.v] for one in points])
    for places in rows_of_each(first_near(powers, _SAME).tolist()).values():
        distinct = list({numbers[place]: points[place] for place in places[::-1]}.values())[::-1]
        if len(distinct) > 1:
            names = some([one.op.name for one in distinct])
            account.remark(
                f"{names} have the same p, q and v{_apart(distinct)}, and are taken as operating "
                "points of their own (--op NAME if they are one)"
            )


def _apart(points: list[PointSweep]) -> str:
    """How far the first two are apart, in words; "" where they have other frequencies."""
    first, second = points[:2]
    if not np.array_equal(first.frequency, second.frequency):
        return ""
    matrices = [one.admittance.reshape(-1, 4) for one in (first, second)]
    return f", but differ by {percent(distance(*matrices))} in the median"
