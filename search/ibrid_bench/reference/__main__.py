"""`python -m ibrid_bench.reference`: every reference inverter swept, fitted, searched and
diagnosed, in one table.

Every row is printed and kept in OUT/results.jsonl as soon as it is there; started again with the
same --out, only what is missing is measured. Delete OUT to measure anew.
"""

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from ibrid_bench.ledger import Ledger, resumable
from ibrid_bench.reference.rows import INVERTERS, TASKS, Effort, FindGap, Task, measured, tasks
from ibrid_bench.reference.tables import heading, line, page
from ibrid_bench.search.scoring import Search
from ibrid_bench.search.trials import BUDGETS
from ibrid_search.running import search as run_search

from ibrid.commands.inputs import count
from ibrid.errors import IbridError, near
from ibrid.gap.workflow import find_gap
from ibrid.writing import require_place, write_whole


def main(
    arguments: Sequence[str] | None = None,
    *,
    search: Search = run_search,
    find_gap: FindGap = find_gap,
) -> int:
    """Measure what the options ask for; 0: done, 1: a row failed or Ctrl-C, 2: the options or the
    folder were wrong.
    """
    options = _parser().parse_args(arguments)
    return resumable("bench-inverters", options.out, lambda: _benchmark(options, search, find_gap))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m ibrid_bench.reference", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument(
        "--inverter",
        action="append",
        default=[],
        metavar="NAME",
        help=f"only these of {', '.join(INVERTERS)}",
    )
    parser.add_argument(
        "--only", action="append", default=[], metavar="KIND", help=f"of rows: {', '.join(TASKS)}"
    )
    budget = BUDGETS["inverters"]
    parser.add_argument(
        "--budget", type=count, default=budget, help=f"evaluations of each search ({budget})"
    )
    parser.add_argument(
        "--searches",
        type=Path,
        default=None,
        help="folder of bench-search whose searches are not made again",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench-inverters"), help="folder of the results"
    )
    parser.add_argument(
        "--page", type=Path, default=None, help="where the page goes (OUT/inverters_results.md)"
    )
    return parser


def _benchmark(options: argparse.Namespace, search: Search, find_gap: FindGap) -> int:
    for asked, known, what in (
        (options.inverter, INVERTERS, "reference inverter"),
        (options.only, TASKS, "kind of row"),
    ):
        for name in asked:
            if name not in known:
                raise IbridError(f"there is no {what} called {name}; {near(name, known)}")
    if options.page is not None:
        require_place(options.page)
    ledger = Ledger(options.out)
    made = {} if options.searches is None else Ledger(options.searches).rows
    effort = Effort(search, options.out / "runs", options.budget, find_gap, made)
    failed = False
    for kind in (one for one in TASKS if not options.only or one in options.only):
        print(f"\n{heading(kind)}", flush=True)
        for task in tasks(options.inverter or INVERTERS, (kind,), options.budget):
            failed |= not _done(task, effort, ledger)
    place = options.page or options.out / "inverters_results.md"
    write_whole(place, page(list(tasks(INVERTERS, TASKS, options.budget)), ledger.rows))
    print(f"\nwritten: {place}")
    return 1 if failed else 0


def _done(task: Task, effort: Effort, ledger: Ledger) -> bool:
    """Measure a row unless it is there, and print it; False when there is none, it is tried again
    next time.
    """
    if task.key not in ledger.rows:
        shutil.rmtree(effort.folder / task.key, ignore_errors=True)  # of a search that was stopped
        effort.folder.mkdir(parents=True, exist_ok=True)
        try:
            ledger.add(measured(task, effort))
        except IbridError as error:
            print(f"{task.key}: {error}", flush=True)
            return False
        shutil.rmtree(effort.folder / task.key, ignore_errors=True)
    print(line(ledger.rows[task.key]), flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
