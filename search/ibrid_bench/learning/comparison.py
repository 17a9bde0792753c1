"""What the rows come to: every arm measured in the same way, and arms beside each other paired by
inverter and seed.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ibrid_bench.learning.arms import ALL_ARMS, INVERTERS, arm_of, controls
from ibrid_bench.learning.course import area, evaluations_to, final_error
from ibrid_bench.learning.statistics import Estimate, Strata, differences, estimate, mean, median
from ibrid_bench.search.scoring import EXACT_ERROR, PAPER_ERROR

Row = Mapping[str, Any]
Rows = Sequence[Row]


@dataclass(frozen=True)
class Measure:
    """`of` : a row; infinite for a limit that was not reached.

    `unit` : "evaluations", "log10" or "share". `smaller` : is better.
    """

    title: str
    of: Callable[[Row], float]
    unit: str
    smaller: bool = True


def _reached(limit: float) -> Callable[[Row], float]:
    return lambda row: evaluations_to(row["curve"], limit, row["budget"])


TO_PAPER_ERROR = Measure("to 0.0435", _reached(PAPER_ERROR), "evaluations")
TO_EXACT_ERROR = Measure("to 1e-3", _reached(EXACT_ERROR), "evaluations")
AREA = Measure("area", lambda row: area(row["curve"], row["budget"]), "log10")
MODULES = Measure("F1 modules", lambda row: row["modules_f1"], "share", smaller=False)
CONNECTIONS = Measure("F1 connections", lambda row: row["connections_f1"], "share", smaller=False)
MEASURES = (TO_PAPER_ERROR, TO_EXACT_ERROR, AREA, MODULES, CONNECTIONS)
FINAL = Measure("final", final_error, "log10")


def current(rows: Iterable[Row]) -> list[Row]:
    """The rows that hold now: of the policy with the weights of the last row that has any, and of
    the same search the last.
    """
    rows = list(rows)
    newest = newest_weights(rows)
    kept = {
        (row["inverter"], row["arm"], row["budget"], row["seed"]): row
        for row in rows
        if row["weights"] in ("", newest)
    }
    return list(kept.values())


def newest_weights(rows: Iterable[Row]) -> str:
    """The weights of the last row that has any, else ""."""
    return next((row["weights"] for row in reversed(list(rows)) if row["weights"]), "")


def budgets(rows: Rows) -> list[int]:
    """Those with which something is compared: with which more than chance was searched. Their rows
    are never put together.
    """
    return sorted({row["budget"] for row in rows if row["arm"] != "random"})


def longest_of_chance(rows: Rows) -> list[Row]:
    """Random edits with the largest budget that they were given, since with the others' they may
    reach nothing.
    """
    chance = [row for row in rows if row["arm"] == "random"]
    longest = max((row["budget"] for row in chance), default=0)
    return [row for row in chance if row["budget"] == longest and row["inverter"] in INVERTERS]


def labels(rows: Rows) -> list[str]:
    """The arms that are there, in the order of `ALL_ARMS`."""
    order = list(ALL_ARMS)
    return sorted(
        {row["arm"] for row in rows},
        key=lambda label: (order.index(arm_of(label)), len(label), label),
    )


def part(rows: Rows, label: str, inverters: Collection[str]) -> list[Row]:
    """The rows of one arm on some inverters."""
    return [row for row in rows if row["arm"] == label and row["inverter"] in inverters]


def of_arm(rows: Rows, measure: Measure) -> Estimate | None:
    """The median over the rows of an arm."""
    strata: dict[str, list[float]] = {}
    for row in rows:
        strata.setdefault(row["inverter"], []).append(measure.of(row))
    return estimate(strata, median)


def pairs(found: Sequence[str]) -> list[tuple[str, str]]:
    """Arms whose difference says something: learning and its controls, first looks, the policy and
    chance, what mixing it with rules adds to either, and what the policy and the diagnosis add to
    each other.
    """
    wanted = []
    for label in (one for one in found if arm_of(one) == "learning"):
        wanted += [(label, other) for other in dict.fromkeys((*controls(label), "blind"))]
    wanted += [("frozen", "blind"), ("frozen", "random")]
    wanted += [(label, "rules") for label in found if arm_of(label) == "mixed"]
    wanted += [("mixed", "frozen"), ("informed", "diagnosis"), ("informed", "frozen")]
    return [pair for pair in wanted if set(pair) <= set(found)]


def of_pair(rows: Rows, first: str, second: str, measure: Measure) -> Estimate | None:
    """The mean of first - second over the pairs of the same inverter and seed; a limit not reached
    counts as the budget.
    """
    values = [
        {
            (row["inverter"], row["seed"]): _counted(measure, row)
            for row in rows
            if row["arm"] == label
        }
        for label in (first, second)
    ]
    strata: Strata = differences(*values)
    return estimate(strata, mean)


def _counted(measure: Measure, row: Row) -> float:
    return min(measure.of(row), row["budget"]) if measure.unit == "evaluations" else measure.of(row)


def verdict(measure: Measure, found: Estimate | None) -> str:
    """A difference in words."""
    if found is None:
        return "not measured yet"
    if found.low is None:
        return "too few seeds for an interval"
    if not found.excludes_zero:
        return "neither a gain nor a loss is shown"
    return "a gain" if (found.value < 0) == measure.smaller else "a loss"


def share(rows: Rows, name: str) -> float | None:
    """The part of the answers of an arm's own proposers that are "valid", "known", "refused" or
    "failed".
    """
    own = [
        one for row in rows for proposer, one in row["proposed"].items() if proposer != "pruning"
    ]
    answers = sum(one["answers"] for one in own)
    return sum(one[name] for one in own) / answers if answers else None


def typical_error(rows: Rows) -> float | None:
    """The median of the best error at the end."""
    found = of_arm(rows, FINAL)
    return None if found is None else 10**found.value
