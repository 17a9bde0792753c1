"""What went wrong in a trial, in words; and which answer stood for which truth."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ibrid_bench.gap.held_out import MOST
from ibrid_bench.gap.scoring import FAILED

Row = Mapping[str, Any]


def miss(row: Row) -> str:
    """Why an answer is not as it should be; "" when it is.

    Below the detection limit only a wrong name is a miss.
    """
    if row["verdict"] == FAILED:
        return f"no answer: {row['failure']}"
    if row["above"] is False:
        wrong = row["answer"] and row["inside_class"] is not True
        return f"{said(row)}, below the detection limit" if wrong else ""
    if not row["right_verdict"] or row["named_first"] is False:
        return said(row)
    if row["all_named"] is False:
        return f"{said(row)}; one of two is missing"
    if row["verdict"] == "named" and (row["holdout"] is None or row["holdout"] > MOST):
        return f"held-out error {_times(row['holdout'])} the noise floor"
    return ""


def said(row: Row) -> str:
    """The answer in words."""
    effects = (
        one + (f" (or {', '.join(others)})" if others else "")
        for one, others in zip(row["answer"], row["classes"], strict=True)
    )
    return " ".join((row["verdict"], " and ".join(effects))).strip()


def hidden(row: Row) -> str:
    """What was hidden, "id:change"; the kind of case where that is nothing."""
    return " + ".join(key.rsplit(":", 1)[0] for key in row["hidden"]) or row["kind"]


def confusions(rows: Iterable[Row]) -> Iterator[tuple[str, str, int]]:
    """(what was hidden, what was said, how often) of all misses but those of the held-out error,
    most frequent first.
    """
    pairs = (
        (hidden(row), " + ".join(row["answer"]) or row["verdict"]) for row in rows if miss(row)
    )
    for (truth, answer), number in Counter(one for one in pairs if one[0] != one[1]).most_common():
        yield truth, answer, number


def _times(ratio: float | None) -> str:
    return "unknown, no prediction over" if ratio is None else f"{ratio:.3g} times"
