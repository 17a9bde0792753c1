"""Ticks of logarithmic axes as plain numbers, 100 and 1e-4, in all figures alike; and the unit that an axis names."""

import re
from typing import TYPE_CHECKING

from ibrid.report.numbers import number

if TYPE_CHECKING:
    from matplotlib.axis import Axis

#: Ratio of the ends up to which a scale gets numbers between its decades: at 2 and 5, and at all of them.
SOME, ALL = 30.0, 3.0


def plain_decades(*drawn: "Axis") -> None:
    """Write the ticks of logarithmic axes as numbers, not powers of ten, which are slow to set and hard to read.

    Between decades there are ticks only where fewer than two decades are shown: without a number they say little, and
    they take a third of the time of a figure.
    """
    from matplotlib.ticker import FuncFormatter, NullLocator

    for one in drawn:
        if one.get_scale() in ("log", "symlog"):
            one.set_major_formatter(FuncFormatter(lambda value, _: _written(value)))
            low, high = one.get_view_interval()
            if one.get_scale() == "log" and low > 0 and high < SOME * low:
                leading = "123456789" if high < ALL * low else "25"
                one.set_minor_formatter(FuncFormatter(lambda value, _, kept=leading: _between(value, kept)))
            else:
                one.set_minor_locator(NullLocator())


def unit_of(axis: "Axis") -> str:
    """What stands in brackets at the end of an axis's label, "" where nothing does."""
    found = re.search(r"\(([^()]*)\)$", axis.get_label_text())
    return found[1] if found else ""


def _written(value: float) -> str:
    return number(value).replace("-", "−", 1) if value < 0 else number(value)


def _between(value: float, kept: str) -> str:
    return _written(value) if f"{value:e}"[0] in kept else ""
