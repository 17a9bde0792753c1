"""The archive in numbers: how proposals ended and why, who made them, the islands, the time, the
settings.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from ibrid.report.pages.template import shortened
from ibrid_search.report.run_data import RunData
from ibrid_search.run.tally import Tally, counts
from ibrid_search.run.trajectory import eligible
from ibrid_search.step import Status, Step


def statistics_facts(run: RunData) -> dict[str, Any]:
    """What the tables of proposals show."""
    proposals = [step for step in run.steps.values() if step.number > 0]
    return {
        "proposals": proposals,
        "endings": _endings(proposals),
        "tallies": [
            ("Proposers", "proposer", _groups(proposals, lambda step: step.proposer or "-")),
            (
                "Scale of the edit asked for",
                "scale",
                _groups(proposals, lambda step: step.scale or "-"),
            ),
            ("Islands", "island", _groups(proposals, lambda step: str(step.island))),
        ],
        "usage": _usage(proposals),
        "settings": run.meta.get("settings", "").strip(),
    }


def _endings(proposals: list[Step]) -> list[dict[str, Any]]:
    """Every status that occurred; `reasons` : (reason, how often), the most frequent first."""
    reasons: dict[Status, Counter[str]] = {}
    for step in proposals:
        if step.reason:
            reasons.setdefault(step.status, Counter())[shortened(step.reason)] += 1
    number = counts(proposals)
    return [
        {
            "status": status,
            "number": number[status],
            "reasons": sorted(
                reasons.get(status, Counter()).items(), key=lambda item: (-item[1], item[0])
            ),
        }
        for status in Status
        if number[status]
    ]


def _groups(
    proposals: Iterable[Step], of: Callable[[Step], str]
) -> list[tuple[str, int, Tally, float | None]]:
    """(name, proposals, what became of them, best NRMSE) of each group."""
    groups: dict[str, list[Step]] = {}
    for step in proposals:
        groups.setdefault(of(step), []).append(step)
    return [
        (
            name,
            len(steps),
            Tally.of(counts(steps)),
            min(
                (step.nrmse for step in steps if eligible(step) and step.nrmse is not None),
                default=None,
            ),
        )
        for name, steps in sorted(groups.items(), key=lambda item: (len(item[0]), item[0]))
    ]


def _usage(proposals: Iterable[Step]) -> dict[str, float]:
    """What proposers used, added up: tokens and money of language models, first looks of the
    rules.
    """
    total: dict[str, float] = {}
    for step in proposals:
        for name, value in step.usage.items():
            if isinstance(value, int | float) and not isinstance(value, bool) and value:
                total[name] = total.get(name, 0) + value
    return total
