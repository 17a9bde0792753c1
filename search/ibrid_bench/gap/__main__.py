"""`make bench-gap`: how often the gap workflow finds and names what is hidden in devices that it
knows nothing of.

Every case is one line, printed and kept in OUT/results.jsonl as soon as it is done; started again
with the same --out, the benchmark goes on where it was stopped. Delete OUT to measure anew. Draw
the seed of a table after the code is done.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from functools import partial
from itertools import islice
from pathlib import Path

from ibrid_bench.gap.diagnosis import Diagnose, diagnose
from ibrid_bench.gap.examination import examine
from ibrid_bench.gap.scoring import Row
from ibrid_bench.gap.several import GROUPS, group_of, several
from ibrid_bench.gap.tables import report, trial_line
from ibrid_bench.gap.trials import NUMBERS, UNSTATED, Trial, design, unstated
from ibrid_bench.ledger import Ledger, resumable

from ibrid.commands.inputs import count
from ibrid.errors import IbridError, near

CASES, QUICK = 200, 20


def main(arguments: Sequence[str] | None = None, *, answer: Diagnose = diagnose) -> int:
    """Run what the options ask for; 0: done, 1: Ctrl-C, 2: the options or the folder were wrong."""
    options = _parser().parse_args(arguments)
    return resumable("bench-gap", options.out, lambda: _benchmark(options, answer))


def _benchmark(options: argparse.Namespace, answer: Diagnose) -> int:
    trials = wanted(
        options.cases or (QUICK if options.quick else CASES), options.seed, options.only
    )
    ledger = Ledger(options.out)
    for done, row in enumerate(_rows(trials, ledger, options, answer), 1):
        print(trial_line(row, done, len(trials)), flush=True)
    print()
    for line in report([ledger.rows[trial.key] for trial in trials]):
        print(line)
    return 0


def wanted(cases: int, seed: int, only: Sequence[str]) -> list[Trial]:
    """The trials of a table; of these the kinds and effects named, and trials named in full, of the
    table or not.

    Raises IbridError when a name is neither.
    """
    table, beside = [*design(cases, seed), *unstated(cases, seed)], several(cases, seed)
    if not only:
        return [*table, *beside]
    found: list[Trial] = []
    for name in only:
        if "/" in name:
            found.append(Trial.parse(name))
            continue
        chosen = [
            one
            for one in table
            if one.group == name or any(key.startswith(f"{name}:") for key in one.effects)
        ]
        chosen += [one for one in beside if group_of(one.effects) == name]
        if not chosen:
            known = {
                *NUMBERS,
                *GROUPS,
                UNSTATED,
                *(key.split(":")[0] for one in table for key in one.effects),
            }
            raise IbridError(
                f"there is no kind of case and no hidden effect called {name}; "
                f"{near(name, sorted(known))}"
            )
        found += chosen
    return list(dict.fromkeys(found))


def _rows(
    trials: Iterable[Trial], ledger: Ledger, options: argparse.Namespace, answer: Diagnose
) -> Iterator[Row]:
    """Rows that are there, then each of the others as it comes."""
    missing = []
    for trial in trials:
        if trial.key in ledger.rows:
            yield dict(ledger.rows[trial.key])
        else:
            missing.append(trial)
    for row in _examined(missing, options, answer):
        ledger.add(row)
        yield row


def _examined(
    trials: Sequence[Trial], options: argparse.Namespace, answer: Diagnose
) -> Iterator[Row]:
    one = partial(examine, out=options.out, answer=answer, keep=options.keep)
    if options.workers == 1 or len(trials) < 2:
        yield from map(one, trials)
        return
    waiting = iter(trials)
    with ProcessPoolExecutor(options.workers) as pool:
        # no more than are at work: Ctrl-C ends these, and nothing is left that would begin
        running = {pool.submit(one, trial) for trial in islice(waiting, options.workers)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= {pool.submit(one, trial) for trial in islice(waiting, len(done))}
            for job in done:
                yield job.result()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m ibrid_bench.gap", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--cases", type=count, default=None, help=f"in the table ({CASES})")
    parser.add_argument(
        "--seed", type=int, default=0, help="from which all devices of the table are drawn (0)"
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help=f"a kind ({', '.join((*NUMBERS, *GROUPS, UNSTATED))}), an effect, or a trial as the "
        "misses have it; repeatable",
    )
    parser.add_argument(
        "--workers", type=count, default=2, help="cases at a time, one core each (2)"
    )
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} cases")
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench-gap"), help="folder of the results"
    )
    parser.add_argument(
        "--keep",
        action="store_true",
        help="keep cases and answers (OUT/cases) and truths (OUT/truths)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
