"""`python -m ibrid_bench.gap.hardware --out OUT`: what built devices have, hidden alone and in
pairs, and how often it is named.

As `make bench-gap`, one line a case in OUT/results.jsonl; the table counts what was named first,
and held-out errors over the noise floor. p and q a factor of sqrt 2 too large counts as named where
the verdict says so of the labels. With `--further` what else the catalogue has is hidden.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from ibrid_bench.gap.diagnosis import diagnose
from ibrid_bench.gap.held_out import MOST, held_out_ratio
from ibrid_bench.gap.scoring import Row, score
from ibrid_bench.hidden.case import write_case
from ibrid_bench.hidden.declaration import HiddenEffect
from ibrid_bench.hidden.further import FURTHER
from ibrid_bench.hidden.hardware import HARDWARE, draw_hardware
from ibrid_bench.ledger import Ledger, resumable
from ibrid_bench.markdown import markdown_table

from ibrid.errors import IbridError

NOISE = (60.0, 50.0, 40.0)


def design(cases: int, seed: int, pool: Sequence[HiddenEffect] = HARDWARE) -> list[tuple[str, ...]]:
    """Effects of so many cases: each alone and each pair that goes together, round after round in
    an order of its own.
    """
    keys = [one.key for one in pool]
    pairs = [(one.key, other.key) for one, other in combinations(pool, 2) if one.id != other.id]
    pairs = [pair for pair in pairs if _drawable(pair, pool)]
    rng = np.random.default_rng(seed)
    found: list[tuple[str, ...]] = []
    while len(found) < cases:
        alone = [(keys[k],) for k in rng.permutation(len(keys))]
        both = [pairs[k] for k in rng.permutation(len(pairs))[: len(alone)]]
        found += [one for couple in zip(alone, both, strict=False) for one in couple]
    return found[:cases]


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done, 1: Ctrl-C, 2: the options or the folder were wrong."""
    parser = argparse.ArgumentParser(
        prog="python -m ibrid_bench.gap.hardware", description="Simulated hardware."
    )
    parser.add_argument("--cases", type=int, default=44)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--further", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(arguments)
    return resumable("bench-hardware", options.out, lambda: _benchmark(options))


def _benchmark(options: argparse.Namespace) -> int:
    ledger = Ledger(options.out)
    keys, pool = [], FURTHER if options.further else HARDWARE
    for number, effects in enumerate(design(options.cases, options.seed, pool)):
        noise, seed = NOISE[number % len(NOISE)], 1000 * options.seed + number
        key = f"{'+'.join(effects)}/{noise:g}dB/{seed}"
        keys.append(key)
        if key not in ledger.rows:
            ledger.add({"key": key, **_answer(effects, noise, seed, pool)})
        row = ledger.rows[key]
        print(
            key,
            row["verdict"],
            row["answer"],
            f"named {row['named_first']}, held out {row['holdout']}",
            flush=True,
        )
    print(report([dict(ledger.rows[key]) for key in keys]))
    return 0


def _answer(effects: Sequence[str], noise: float, seed: int, pool: Sequence[HiddenEffect]) -> Row:
    case = draw_hardware(seed, effects, noise_db=noise, pool=pool)
    with tempfile.TemporaryDirectory() as folder:
        write_case(case, Path(folder) / "case", Path(folder) / "truth")
        diagnosis = diagnose(Path(folder) / "case")
    row = score(case, diagnosis, ())
    if "data-convention" in case.truth["verdicts"]:
        ids = {one.split(":")[0] for one in row["hidden"]}
        told = [one.split(":")[0] for one in row["answer"]]
        classes = [{name, *alike} for name, alike in zip(told, row["classes"], strict=True)]
        row["named_first"] = bool(classes) and bool(ids & classes[0])
        row["all_named"] = ids <= set().union(*classes) if len(ids) > 1 else None
        if row["verdict"] == "data-convention" and diagnosis.record:
            row["holdout"] = held_out_ratio(diagnosis.record, case)
    return row


def report(rows: Sequence[Row]) -> str:
    """How many were named first, all named of pairs, and held-out errors within `MOST` floors, by
    what is hidden.
    """
    groups = {
        "alone": [one for one in rows if len(one["hidden"]) == 1],
        "in pairs": [one for one in rows if len(one["hidden"]) > 1],
    }
    for key in sorted({name for one in rows for name in one["hidden"]}):
        groups[key] = [one for one in rows if key in one["hidden"]]
    lines = []
    for name, some in groups.items():
        held = [one["holdout"] for one in some if one["holdout"] is not None]
        both = [one["all_named"] for one in some if one["all_named"] is not None]
        lines.append(
            (
                name,
                str(len(some)),
                f"{sum(bool(one['named_first']) for one in some)} of {len(some)}",
                f"{sum(map(bool, both))} of {len(both)}" if both else "",
                f"{sum(one <= MOST for one in held)} of {len(some)}",
                f"{np.median(held):.2f}" if held else "",
                f"{np.median([one['seconds'] for one in some]):.0f}" if some else "",
            )
        )
    head = (
        "hidden",
        "cases",
        "named first",
        "all named",
        f"held out within {MOST:g} floors",
        "median floors",
        "seconds",
    )
    return markdown_table(head, lines)


def _drawable(pair: Sequence[str], pool: Sequence[HiddenEffect]) -> bool:
    try:
        draw_hardware(0, pair, frequencies=4, points=1, pool=pool)
    except IbridError:
        return False
    return True


if __name__ == "__main__":
    sys.exit(main())
