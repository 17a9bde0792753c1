"""`make bench-search`: how often, how fast and how well the search finds hidden inverters, beside
random edits.

Every search is one line, printed and kept in OUT/results.jsonl as soon as it is done; started again
with the same --out, the benchmark goes on where it was stopped. Ledgers of parts made side by side
may be joined line by line. Delete OUT to measure anew.
"""

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from ibrid_bench.ledger import Ledger, resumable
from ibrid_bench.search.page import page
from ibrid_bench.search.scoring import Search, perform
from ibrid_bench.search.side_by_side import BESIDE, side_by_side
from ibrid_bench.search.side_by_side import PROPOSERS as ALL_PROPOSERS
from ibrid_bench.search.speed_table import speed_lines
from ibrid_bench.search.tables import heading, seed_line, summary
from ibrid_bench.search.trials import BUDGETS, NOISY_BUDGET, PROPOSERS, TABLES, Trial, trials
from ibrid_search.running import search as run_search

from ibrid.commands.inputs import count, natural
from ibrid.errors import IbridError
from ibrid.writing import require_place, write_whole

#: Seeds and budget of --quick: an hour less, nothing to quote.
QUICK = {"seeds": 2, "budget": 100}
SPEED = "speed"


def main(arguments: Sequence[str] | None = None, *, search: Search = run_search) -> int:
    """Run what the options ask for; 0: done, 1: a search failed or Ctrl-C, 2: the options or the
    folder were wrong.
    """
    options = _parser().parse_args(arguments)
    if options.quick:
        options.seeds, options.budget = (
            options.seeds or QUICK["seeds"],
            options.budget or QUICK["budget"],
        )
    return resumable("bench-search", options.out, lambda: _benchmark(options, search))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m ibrid_bench.search", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--seeds", type=count, default=None, help="searches of each kind (10)")
    parser.add_argument(
        "--first", type=natural, default=0, metavar="SEED", help="seed of the first of them (0)"
    )
    budgets = (
        ", ".join(f"{table} {budget}" for table, budget in BUDGETS.items())
        + f"; noisy data {NOISY_BUDGET}"
    )
    parser.add_argument(
        "--budget", type=count, default=None, help=f"evaluations of each search ({budgets})"
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help=f"a table ({', '.join((*TABLES, BESIDE, SPEED))}) or an inverter",
    )
    parser.add_argument(
        "--data",
        action="append",
        default=[],
        metavar="NOISE",
        help='"clean", "50 dB" and so on (all)',
    )
    parser.add_argument(
        "--proposer",
        action="append",
        default=[],
        metavar="NAME",
        help="instead of rules and random",
    )
    parser.add_argument("--workers", type=count, default=2, help="workers of each search (2)")
    parser.add_argument(
        "--quick", action="store_true", help="2 seeds, 100 evaluations, one inverter of each sort"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench-search"), help="folder of the results"
    )
    parser.add_argument(
        "--page", type=Path, default=None, help="where the page goes (OUT/search_results.md)"
    )
    parser.add_argument(
        "--keep", action="store_true", help="keep the run folders (OUT/runs), for ibrid report"
    )
    return parser


def _benchmark(options: argparse.Namespace, search: Search) -> int:
    tables = [name for name in options.only if name not in (BESIDE, SPEED)]
    wanted: list[Trial] = []
    if tables or not options.only:
        seeds, proposers = (
            range(options.first, options.first + (options.seeds or 10)),
            options.proposer or PROPOSERS,
        )
        wanted = list(
            trials(
                seeds,
                options.budget,
                only=tables,
                proposers=proposers,
                data=options.data,
                few=options.quick,
            )
        )
    if options.page is not None:
        require_place(options.page)
    ledger = Ledger(options.out)
    if not options.only or SPEED in options.only:
        quick = {"evaluations": QUICK["budget"], "answers": 32} if options.quick else {}
        for line in speed_lines(ledger, search, options.out, **quick):
            print(line, flush=True)
    if BESIDE in options.only:
        seeds = range(options.first, options.first + (options.seeds or 1))
        for line in side_by_side(
            ledger, search, options.out, options.proposer or ALL_PROPOSERS, seeds
        ):
            print(line, flush=True)
    failed: list[Trial] = []
    if wanted:
        print(heading(), flush=True)
        failed = [trial for trial in wanted if not _done(trial, ledger, options, search)]
        print(f"\nMedians over seeds\n{heading()}")
        for line in summary(ledger.rows[trial.key] for trial in wanted if trial not in failed):
            print(line)
    place = options.page or options.out / "search_results.md"
    write_whole(place, page(ledger.rows))
    print(f"\nwritten: {place}")
    return 1 if failed else 0


def _done(trial: Trial, ledger: Ledger, options: argparse.Namespace, search: Search) -> bool:
    """Make a search unless its result is there, and print it; False when it has none, it is tried
    again next time.
    """
    if trial.key not in ledger.rows:
        folder = options.out / "runs" / trial.key
        shutil.rmtree(folder, ignore_errors=True)  # of a search that was stopped
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            row = perform(trial, folder, search=search, workers=options.workers)
        except IbridError as error:
            print(f"{trial.key}: {error}", flush=True)
            return False
        ledger.add(row)
        if not options.keep:
            shutil.rmtree(folder, ignore_errors=True)
    print(seed_line(ledger.rows[trial.key]), flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
