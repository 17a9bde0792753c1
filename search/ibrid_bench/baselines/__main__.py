"""`python -m ibrid_bench.baselines`: black boxes, sparse regression, textbook diagrams and the
search on the same data.

Every row is printed and kept in OUT/results.jsonl as soon as it is there; started again with the
same --out, only what is missing is measured. Delete OUT to measure anew.
"""

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from ibrid_bench.baselines.case import INVERTERS, Case, cases_of
from ibrid_bench.baselines.methods import METHODS, Effort, measured, placed, row_key
from ibrid_bench.baselines.tables import heading, line, page
from ibrid_bench.ledger import Ledger, resumable
from ibrid_bench.search.scoring import Search
from ibrid_bench.search.trials import BUDGETS
from ibrid_search.running import search as run_search

from ibrid.commands.inputs import count
from ibrid.errors import IbridError, near
from ibrid.writing import require_place, write_whole


def main(arguments: Sequence[str] | None = None, *, search: Search = run_search) -> int:
    """Measure what the options ask for; 0: done, 1: a row failed or Ctrl-C, 2: the options or the
    folder were wrong.
    """
    options = _parser().parse_args(arguments)
    return resumable("baselines", options.out, lambda: _benchmark(options, search))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m ibrid_bench.baselines", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument(
        "--inverter",
        action="append",
        default=[],
        metavar="NAME",
        help=f"instead of {', '.join(INVERTERS)}",
    )
    parser.add_argument(
        "--method",
        action="append",
        default=[],
        metavar="NAME",
        help=f"only these of {', '.join(METHODS)}",
    )
    budget = BUDGETS["inverters"]
    parser.add_argument(
        "--budget", type=count, default=budget, help=f"evaluations of the search ({budget})"
    )
    parser.add_argument(
        "--searches",
        type=Path,
        default=None,
        help="folder of bench-search whose searches are not made again",
    )
    parser.add_argument("--workers", type=count, default=1, help="workers of the search (1)")
    parser.add_argument(
        "--out", type=Path, default=Path("out/baselines"), help="folder of the results"
    )
    parser.add_argument(
        "--page", type=Path, default=None, help="where the page goes (OUT/baselines.md)"
    )
    return parser


def _benchmark(options: argparse.Namespace, search: Search) -> int:
    for name in options.method:
        if name not in METHODS:
            raise IbridError(f"there is no method called {name}; {near(name, METHODS)}")
    cases = cases_of(options.inverter or INVERTERS)
    if options.page is not None:
        require_place(options.page)
    ledger = Ledger(options.out)
    made = {} if options.searches is None else Ledger(options.searches).rows
    effort = Effort(search, options.out / "runs", options.budget, options.workers, made)
    failed = False
    for case in cases:
        print(f"\n{case.name}\n{heading()}", flush=True)
        for name in METHODS:
            if not options.method or name in options.method:
                failed |= not _done(case, name, effort, ledger)
    whole = cases_of([*INVERTERS, *options.inverter])
    place = options.page or options.out / "baselines.md"
    write_whole(place, page(whole, placed(whole, ledger.rows, options.budget)))
    print(f"\nwritten: {place}")
    return 1 if failed else 0


def _done(case: Case, method: str, effort: Effort, ledger: Ledger) -> bool:
    """Measure a row unless it is there, and print it; False when the method failed, it is tried
    again next time.
    """
    key = row_key(case, method, effort.budget)
    if key not in ledger.rows:
        shutil.rmtree(effort.folder / key, ignore_errors=True)  # of a search that was stopped
        effort.folder.mkdir(parents=True, exist_ok=True)
        try:
            ledger.add(measured(case, method, effort))
        except IbridError as error:
            print(f"{METHODS[method].title}: {error}", flush=True)
            return False
        shutil.rmtree(effort.folder / key, ignore_errors=True)
    print(line(dict(ledger.rows[key])), flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
