"""The rows of every table: what each method is called, and how it makes its answer of a case."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ibrid_bench.baselines.answer import Answer, Row, scored
from ibrid_bench.baselines.black_box import between_points, nearest_point
from ibrid_bench.baselines.case import Case
from ibrid_bench.baselines.diagrams import searched, true_structure, wrong_structure
from ibrid_bench.baselines.grey_box import at_terminals, behind_filter
from ibrid_bench.search.scoring import Rows, Search

#: Key of the row that is a search.
SEARCH = "search"


@dataclass(frozen=True)
class Effort:
    """How the search is made: in `folder`/KEY, with `budget` evaluations by `workers`; by `search`,
    or its stand-in in tests.
    `ledger` : of searches that need not be made again.
    """

    search: Search
    folder: Path
    budget: int
    workers: int
    ledger: Rows = field(default_factory=dict)


@dataclass(frozen=True)
class Method:
    """A row. `title` : in the tables. `answer` : of a case. `on_grid` : fitted to the nine points
    of `Case.grid`.
    """

    title: str
    answer: Callable[[Case, Effort], Answer]
    on_grid: bool = False


def _on_points(method: Callable[..., Answer]) -> Callable[[Case, Effort], Answer]:
    def answer(case: Case, effort: Effort) -> Answer:
        return method(case.hidden.sweep, case.held_out.op, case.held_out.frequency)

    return answer


def _on_grid(case: Case, effort: Effort) -> Answer:
    return between_points(case.grid()[0], case.held_out.op, case.held_out.frequency)


def _behind_filter(case: Case, effort: Effort) -> Answer:
    return behind_filter(case.hidden.sweep, case.held_out.op, case.held_out.frequency, case.values)


def _searched(case: Case, effort: Effort) -> Answer:
    folder = effort.folder / row_key(case, SEARCH, effort.budget)
    return searched(
        case,
        folder,
        search=effort.search,
        budget=effort.budget,
        workers=effort.workers,
        ledger=effort.ledger,
    )


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "vector-fitting-nearest": Method(
            "vector fitting, nearest point", _on_points(nearest_point)
        ),
        "vector-fitting-between": Method(
            "vector fitting, between the two", _on_points(between_points)
        ),
        "vector-fitting-nine": Method(
            "vector fitting, nine points measured", _on_grid, on_grid=True
        ),
        "sparse-terminals": Method("sparse regression at the terminals", _on_points(at_terminals)),
        "sparse-filter": Method("sparse regression behind the filter", _behind_filter),
        "textbook": Method(
            "white box, the true structure", lambda case, effort: true_structure(case)
        ),
        "textbook-wrong": Method(
            "white box, no filter before the PLL", lambda case, effort: wrong_structure(case)
        ),
        SEARCH: Method("search from the naive diagram", _searched),
    }
)


def row_key(case: Case, method: str, budget: int) -> str:
    """Names a row in the ledger; the search's budget is part of it."""
    data = case.trial(budget).data.replace(" ", "")
    return f"{case.inverter}-{data}-{method}" + (f"-{budget}" if method == SEARCH else "")


def placed(
    cases: Sequence[Case], rows: Rows, budget: int
) -> Mapping[tuple[Case, str], Mapping[str, Any]]:
    """The rows of a ledger that belong to these cases and methods, by both."""
    keys = {(case, name): row_key(case, name, budget) for case in cases for name in METHODS}
    return {place: rows[key] for place, key in keys.items() if key in rows}


def measured(case: Case, method: str, effort: Effort) -> Row:
    """The row of a method, measured now; IbridError when the method has no answer."""
    started = time.perf_counter()
    chosen = METHODS[method]
    answer = chosen.answer(case, effort)
    taken = time.perf_counter() - started
    data, truth = case.grid() if chosen.on_grid else (case.hidden.sweep, case.clean.sweep)
    return {
        "key": row_key(case, method, effort.budget),
        "inverter": case.inverter,
        "method": method,
        "data": case.trial(effort.budget).data,
        **scored(answer, data, truth, case.held_out),
        "of": len(case.values),
        "seconds": round(taken if answer.seconds is None else answer.seconds, 2),
    }
