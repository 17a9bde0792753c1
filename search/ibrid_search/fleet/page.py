"""The page of a fleet: families, outliers, drifts, and the files that have no answer."""

from typing import Any

from ibrid.report.template import page
from ibrid_search.fleet.summary import Summary

#: Lines of a table at most; the table beside the page has all.
MOST = 200


def fleet_html(summary: Summary) -> str:
    """The page as text."""
    busy = sum(one.seconds for one in summary.devices)
    facts: dict[str, Any] = {
        "fleet": summary,
        "most": MOST,
        "seconds_each": busy / max(len(summary.devices), 1),
        "expected": sum(one.expected for one in summary.devices),
        "again": sum(one.attempts > 1 for one in summary.devices),
    }
    return page("fleet.html", facts, "ibrid_search")
