"""Results of searches as lines: one for each seed when it is there, one for each group of seeds at
the end.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from math import inf
from statistics import median_high
from typing import Any

from ibrid_bench.search.scoring import finding

Row = Mapping[str, Any]

_WIDTH = 26
_HEAD = (
    "NRMSE",
    "answer",
    "truth",
    "held out",
    "F1 mod/con",
    "evaluations",
    "to limit",
    "seconds",
    "found",
)


def seed_line(row: Row) -> str:
    """One search; the columns of `heading`."""
    cells = (
        _number(row["nrmse"]),
        _number(row["answer_nrmse"]),
        _number(row["truth_nrmse"]),
        _number(row["holdout"]),
        _pair(row["modules_f1"], row["connections_f1"]),
        str(row["evaluations"]),
        "-" if row["first"] is None else str(row["first"]),
        f"{row['seconds']:.1f}",
        finding(row),
    )
    return _line(f"{_name(row)} {row['seed']}", cells)


def heading() -> str:
    """Names of the columns of `seed_line` and `summary`.

    NRMSE: lowest in the search; answer: of the program it answers with, fitted anew; truth: of the
    true diagram fitted to the same data; held out: of the answer at an operating point that the
    search never saw; to limit: evaluations until the NRMSE that counts.
    """
    return _line("table inverter data proposer seed", _HEAD)


def summary(rows: Iterable[Row]) -> list[str]:
    """For each inverter, data and proposer the medians over seeds, and how many of them found it;
    proposers side by side.
    """
    return [_group_line(group) for group in groups(rows)]


def groups(rows: Iterable[Row]) -> list[list[Row]]:
    """Searches that differ in nothing but the seed, together."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        key = (row["table"], row["inverter"], row["data"], row["budget"], row["proposer"])
        found.setdefault(key, []).append(row)
    return list(found.values())


def _group_line(rows: Sequence[Row]) -> str:
    cells = (
        *(
            _number(median_of(rows, name))
            for name in ("nrmse", "answer_nrmse", "truth_nrmse", "holdout")
        ),
        _pair(median_of(rows, "modules_f1"), median_of(rows, "connections_f1")),
        f"{median_of(rows, 'evaluations'):.0f}",
        median_to_limit(rows),
        f"{median_of(rows, 'seconds'):.1f}",
        findings(rows),
    )
    return _line(_name(rows[0]), cells)


def error_words(value: float | None) -> str:
    """An NRMSE as the pages show it."""
    if value is None:
        return "-"
    return f"{value:.1e}" if value < 1e-3 else f"{value:.4f}"


def verdict_words(success: bool | None) -> str:
    """yes, no, or "-" where there is no verdict."""
    return {None: "-", True: "yes", False: "no"}[success]


def findings(rows: Sequence[Row]) -> str:
    """How many found it, and of the others how often the data do not decide: "7 of 10, 2 listed";
    "-" without a truth.
    """
    counts = Counter(finding(row) for row in rows)
    known = counts.total() - counts.pop("-", 0)
    if not known:
        return "-"
    undecided = [f"{counts[word]} {word}" for word in ("listed", "preferred") if counts[word]]
    return ", ".join([f"{counts['yes']} of {known}", *undecided])


def median_of(rows: Sequence[Row], name: str) -> float | None:
    """Median of a column over the rows that have it, of two in the middle the upper one; None for
    none.
    """
    found = [row[name] for row in rows if row[name] is not None]
    return median_high(found) if found else None


def median_to_limit(rows: Sequence[Row]) -> str:
    """Median of the evaluations until the error was reached; "-" where half of the searches never
    got there.
    """
    found = median_high(inf if row["first"] is None else row["first"] for row in rows)
    return "-" if found == inf else str(found)


def _name(row: Row) -> str:
    return f"{row['table']} {row['inverter']} {row['data']} {row['proposer']}"


def _line(name: str, cells: Sequence[str]) -> str:
    return f"{name:{2 * _WIDTH}}" + " ".join(f"{cell:>11}" for cell in cells)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2e}"


def _pair(first: float | None, second: float | None) -> str:
    return "-" if first is None or second is None else f"{first:.2f}/{second:.2f}"
