"""`make bench-learning`: does the policy help, and does training it during the search help further?

Every search is one line, printed and kept in OUT/results.jsonl as soon as it is done; started again
with the same --out, only what is missing is made. Ledgers of parts made side by side may be joined
line by line. Delete OUT to measure anew.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from ibrid_bench.learning.arms import (
    ALL_ARMS,
    ARMS,
    DRAWN,
    INVERTERS,
    PROFILE,
    Case,
    cases,
    weights_digest,
)
from ibrid_bench.learning.comparison import current, longest_of_chance
from ibrid_bench.learning.measuring import Search, measured
from ibrid_bench.learning.page import measured_of, page
from ibrid_bench.learning.tables import arms_table, heading, line, pairs_table, sentences
from ibrid_bench.ledger import NAME, Ledger, resumable
from ibrid_policy.learning.settings import profile
from ibrid_search.running import search as run_search

from ibrid.commands.inputs import count, positive
from ibrid.errors import IbridError
from ibrid.writing import require_place, write_whole


def require_policy() -> None:
    """Raise IbridError unless the policy can be asked on this machine."""
    from ibrid_policy.small_policy import SmallPolicy

    SmallPolicy()


def main(
    arguments: Sequence[str] | None = None,
    *,
    search: Search = run_search,
    ready: Callable[[], None] = require_policy,
) -> int:
    """Run what the options ask for; 0: done, 1: a search failed or Ctrl-C, 2: the options or the
    folder were wrong.

    ready : raises IbridError where the policy cannot be asked, before any of its arms begins.
    """
    options = _parser().parse_args(arguments)
    return resumable("bench-learning", options.out, lambda: _benchmark(options, search, ready))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m ibrid_bench.learning", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument(
        "--seeds", type=count, default=3, help="searches of each arm on each inverter (3; all: 10)"
    )
    parser.add_argument(
        "--budget", type=count, default=256, help="evaluations of each search (256)"
    )
    parser.add_argument(
        "--inverter",
        action="append",
        default=[],
        metavar="NAME",
        help=f"only these of {', '.join(INVERTERS)}, or, another inverter for every seed, "
        f"{', '.join(DRAWN)}",
    )
    parser.add_argument(
        "--arm",
        action="append",
        default=[],
        metavar="NAME",
        help=f"instead of {', '.join(ARMS)}; known are {', '.join(ALL_ARMS)}",
    )
    parser.add_argument(
        "--profile",
        metavar="NAME",
        default=PROFILE,
        help=f"settings of learning to begin with ({PROFILE})",
    )
    parser.add_argument(
        "--contexts", type=count, help="questions of a batch (the profile's, as all of these)"
    )
    parser.add_argument("--group", type=count, help="answers to each question")
    parser.add_argument("--epochs", type=count, help="updates from each batch")
    parser.add_argument(
        "--optimizer", metavar="WAY", help="what makes a step from a gradient: adam or sgd"
    )
    parser.add_argument("--rate", type=positive, help="learning rate")
    parser.add_argument(
        "--judge",
        metavar="WHO",
        help="fit: every answer is evaluated; look: a first look judges all, one is",
    )
    parser.add_argument(
        "--baseline",
        metavar="WAY",
        help="answers are compared with their group, or with their parent",
    )
    parser.add_argument(
        "--advantages",
        metavar="WAY",
        help="what is made better: the mean answer, or the best (entropic)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench-learning"), help="folder of the results"
    )
    parser.add_argument(
        "--page", type=Path, default=None, help="where the page goes (OUT/learning_results.md)"
    )
    return parser


def _benchmark(options: argparse.Namespace, search: Search, ready: Callable[[], None]) -> int:
    names = ("contexts", "group", "epochs", "optimizer", "rate", "advantages", "judge", "baseline")
    asked = {name: found for name in names if (found := getattr(options, name)) is not None}
    settings = replace(profile(options.profile), **asked)
    wanted = list(
        cases(
            options.seeds,
            options.budget,
            settings,
            inverters=options.inverter,
            arms=options.arm,
            weights=weights_digest(),
        )
    )
    if options.page is not None:
        require_place(options.page)
    known = Ledger(options.out).rows if (options.out / NAME).exists() else {}
    if any("curve" not in row for row in known.values()):
        raise IbridError(
            f"{options.out / NAME}: holds results of another benchmark; try another --out"
        )
    if any(ALL_ARMS[case.arm].asks_policy and case.key not in known for case in wanted):
        ready()
    ledger = Ledger(options.out)
    print(heading(), flush=True)
    failed = [case for case in wanted if not _done(case, ledger, search)]
    kept = current(ledger.rows.values())
    rows = [row for row in kept if row["budget"] == options.budget]
    print(
        f"\n{measured_of(rows)} Medians, then mean "
        f"differences:\n\n{arms_table(rows)}\n{pairs_table(rows)}"
    )
    print("".join(f"{one}\n" for one in sentences(rows, longest_of_chance(kept))), end="")
    place = options.page or options.out / "learning_results.md"
    write_whole(place, page(ledger.rows.values()))
    print(f"\nwritten: {place}")
    return 1 if failed else 0


def _done(case: Case, ledger: Ledger, search: Search) -> bool:
    """Make a search unless its row is there, and print it; False when it has none, it is tried
    again next time.
    """
    if case.key not in ledger.rows:
        with tempfile.TemporaryDirectory(prefix="ibrid-learning-") as folder:
            try:
                row = measured(case, Path(folder) / "run", search)
            except IbridError as error:
                print(f"{case.key}: {error}", flush=True)
                return False
        ledger.add(row)
    print(line(ledger.rows[case.key]), flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
