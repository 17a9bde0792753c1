"""Proposers side by side on the same data: the best error after so many evaluations, and after so
many seconds of one core.
"""

import contextlib
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median_high
from typing import Any

from ibrid_bench.ledger import Ledger
from ibrid_bench.search.inverters import inverter_names
from ibrid_bench.search.scoring import NOISE_MARGIN, Search, fitted
from ibrid_bench.search.trials import BENCHMARK, PAIRS, Trial
from ibrid_search.recursion.progress import Progress, Snapshot
from ibrid_search.settings import SearchSettings

from ibrid.structure.diagrams.library import textbook

Row = Mapping[str, Any]

#: The table's name.
BESIDE = "beside"
#: Where the errors are compared: evaluations, and processor seconds of the whole search.
EVALUATIONS, SECONDS = (10, 30, 100), (15, 30, 60)
#: The default, and what there is beside it.
PROPOSERS = ("diagnosis", "rules", "policy", "random")
NOISE_DB = 50.0
#: Every third of the hidden inverters, so that all families are there.
INVERTERS = tuple(name for name in inverter_names()[::3] if name not in PAIRS)


class _Known(Exception):
    """The search went beyond everything that is compared."""


class Course(Progress):
    """Takes down the best error on the way, `after` so many evaluations and seconds; ends a search
    that has made them all.
    """

    def __init__(self) -> None:
        super().__init__("silent")
        self._began = time.process_time()
        self.after: dict[str, dict[str, float | None]] = {
            "evaluations": dict.fromkeys(map(str, EVALUATIONS)),
            "seconds": dict.fromkeys(map(str, SECONDS)),
        }

    def update(self, snapshot: Snapshot) -> None:
        """Take note of where the search stands."""
        spent = time.process_time() - self._began
        for name, limits, used in (
            ("evaluations", EVALUATIONS, snapshot.evaluations),
            ("seconds", SECONDS, spent),
        ):
            for limit in limits:
                if used <= limit:
                    self.after[name][str(limit)] = snapshot.best
        if snapshot.evaluations > EVALUATIONS[-1] and spent > SECONDS[-1]:
            raise _Known


def trials(proposers: Sequence[str], seeds: Iterable[int]) -> Iterator[Trial]:
    """The searches of the table; their budget is out of reach."""
    for seed in seeds:
        for name in INVERTERS:
            for proposer in proposers:
                table = "structure" if name == BENCHMARK else "inverters"
                yield Trial(table, name, proposer, seed, 100_000, NOISE_DB)


def side_by_side(
    ledger: Ledger, search: Search, out: Path, proposers: Sequence[str], seeds: Iterable[int]
) -> Iterator[str]:
    """Make the searches that the ledger lacks; a line for each."""
    for trial in trials(proposers, seeds):
        key = f"{BESIDE}-{trial.key}"
        if key not in ledger.rows:
            folder = out / "runs" / key
            shutil.rmtree(folder, ignore_errors=True)
            folder.parent.mkdir(parents=True, exist_ok=True)
            ledger.add({"key": key, **course(trial, folder, search)})
            shutil.rmtree(folder, ignore_errors=True)
        yield f"{key}: {ledger.rows[key]['after']}"


def course(trial: Trial, folder: Path, search: Search) -> Row:
    """The errors of a search on its way, beside that of the true diagram fitted to the same
    data.
    """
    hidden, taken = trial.hidden(), Course()
    with contextlib.suppress(_Known):
        search(
            hidden.sweep,
            folder,
            proposer=trial.proposer,
            budget=trial.budget,
            seed=trial.seed,
            workers=1,
            holdout_op=(),
            start=None if trial.start is None else textbook(trial.start),
            settings=SearchSettings(devices=trial.devices),
            progress=taken,
            **trial.mode,
        )
    truth = trial.truth(hidden)
    assert truth is not None, "every inverter of the table has a diagram"
    return {
        "table": BESIDE,
        "inverter": trial.inverter,
        "proposer": trial.proposer,
        "seed": trial.seed,
        "noise_db": trial.noise_db,
        "truth_nrmse": fitted(trial, hidden, truth).nrmse,
        "after": taken.after,
    }


def head() -> tuple[str, ...]:
    """Names of the columns of `lines`."""
    evaluations, seconds = (", ".join(map(str, limits)) for limits in (EVALUATIONS, SECONDS))
    return (
        "proposer",
        "searches",
        f"reached within {evaluations} evaluations",
        "error / truth's there, median",
        f"reached within {seconds} s",
        "error / truth's there, median",
    )


def lines(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """A line for each proposer: how many reached the noise, and the median of the error over that
    of the refitted truth.
    """
    cells = []
    for proposer in dict.fromkeys(row["proposer"] for row in rows):
        own = [row for row in rows if row["proposer"] == proposer]
        told: list[str] = []
        for name, limits in (("evaluations", EVALUATIONS), ("seconds", SECONDS)):
            ratios = [[_over_truth(row, name, limit) for row in own] for limit in limits]
            told.append(", ".join(str(sum(one <= NOISE_MARGIN for one in some)) for some in ratios))
            told.append(", ".join(_short(median_high(some)) for some in ratios))
        cells.append((proposer, str(len(own)), *told))
    return cells


def _over_truth(row: Row, name: str, limit: int) -> float:
    error = row["after"][name][str(limit)]
    return float("inf") if error is None else error / row["truth_nrmse"]


def _short(ratio: float) -> str:
    return "-" if ratio == float("inf") else f"{ratio:.3g}"
