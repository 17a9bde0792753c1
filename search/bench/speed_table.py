"""The speed table: every figure beside its target, kept in the ledger like the searches."""

import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ibrid.ledger import Ledger
from search.bench.scoring import Search
from search.bench.speed import archive_milliseconds, candidates, fits_a_second, local, on_ray, pace

#: A search whose paces are compared lasts this many evaluations.
EVALUATIONS = 500


def speed_lines(ledger: Ledger, search: Search, out: Path, *, evaluations: int = EVALUATIONS) -> Iterator[str]:
    """Measure what the ledger lacks; a line for each figure as soon as it is there.

    evaluations : length of the searches whose paces are compared. Raises IbridError where a search or Ray fails.
    """

    def known(name: str, measure: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any]:
        key = f"speed-{name}"
        if key not in ledger.rows:
            ledger.add({"key": key, "table": "speed", **measure()})
        return ledger.rows[key]

    archive = known("archive", lambda: {"milliseconds": archive_milliseconds()})
    yield f"archive with 10,000 entries, sample + admit   {archive['milliseconds']:7.3f} ms        (target 2 ms)"

    programs = candidates()
    one = known("fits-1", lambda: {"rate": fits_a_second(local, programs)})
    yield f"fits, 13 states, this process                 {one['rate']:7.1f} a second"
    two = known("fits-2", lambda: {"rate": fits_a_second(lambda: on_ray(2), programs)})
    yield (
        f"fits, 13 states, two workers                  {two['rate']:7.1f} a second  (target 15)   "
        f"{two['rate'] / one['rate']:.2f} x (target 1.8 x)"
    )

    def searched(workers: int) -> Mapping[str, Any]:
        folder = out / "runs" / f"speed-{workers}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        found = pace(search, folder, workers=workers, budget=evaluations)
        shutil.rmtree(folder, ignore_errors=True)
        return {**asdict(found), "rate": found.rate, "overhead": found.overhead}

    alone = known(f"search-1-{evaluations}", lambda: searched(1))
    yield (
        f"search, one worker, {alone['evaluations']:3d} evaluations           {alone['rate']:7.1f} a second   "
        f"not fitting {alone['overhead']:.1%} (target 5 %)"
    )
    both = known(f"search-2-{evaluations}", lambda: searched(2))
    yield (
        f"search, two workers, {both['evaluations']:3d} evaluations          {both['rate']:7.1f} a second  (target 15)   "
        f"{both['rate'] / alone['rate']:.2f} x (target 1.8 x)"
    )
