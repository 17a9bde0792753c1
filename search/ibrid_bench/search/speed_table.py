"""The speed table: every figure beside its target, kept in the ledger like the searches."""

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ibrid_bench.ledger import Ledger
from ibrid_bench.search.scoring import Rows, Search
from ibrid_bench.search.speed import (
    archive_milliseconds,
    candidates,
    fits_a_second,
    local,
    on_ray,
    pace,
    policy_step,
)

#: A search whose paces are compared lasts this many evaluations.
EVALUATIONS = 500
#: Of a step of the policy, as many as the paper's.
ANSWERS = 512


def speed_lines(
    ledger: Ledger,
    search: Search,
    out: Path,
    *,
    evaluations: int = EVALUATIONS,
    answers: int = ANSWERS,
) -> Iterator[str]:
    """Measure what the ledger lacks; a line for each figure as soon as it is there, or why it is
    not.

    evaluations : length of the searches whose paces are compared. answers : of a step of the
    policy. Raises IbridError where a search or Ray fails.
    """

    @contextmanager
    def room(name: str) -> Iterator[Path]:
        folder = out / "runs" / f"speed-{name}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        yield folder
        shutil.rmtree(folder, ignore_errors=True)

    def searched(workers: int) -> Mapping[str, Any]:
        with room(str(workers)) as folder:
            found = pace(search, folder, workers=workers, budget=evaluations)
        return {**asdict(found), "rate": found.rate, "overhead": found.overhead}

    def taught() -> Mapping[str, Any]:
        with room("policy") as folder:
            return policy_step(search, folder, answers=answers)

    programs = candidates()
    measures: tuple[Callable[[], Mapping[str, Any]], ...] = (
        lambda: {"milliseconds": archive_milliseconds()},
        lambda: {"rate": fits_a_second(local, programs)},
        lambda: {"rate": fits_a_second(lambda: on_ray(2), programs)},
        lambda: searched(1),
        lambda: searched(2),
        taught,
    )
    for name, measure in zip(_figures(evaluations, answers), measures, strict=True):
        key = f"speed-{name}"
        if key not in ledger.rows and measure is taught and not learns():
            yield f"{_step(answers)} not measured, it needs torch and transformers; make setup-llm"
            continue
        if key not in ledger.rows:
            ledger.add({"key": key, "table": "speed", **measure()})
        yield _line(name, ledger.rows)


def learns() -> bool:
    """True where a policy can be trained."""
    return all(find_spec(name) is not None for name in ("torch", "transformers"))


def known_speed_lines(
    rows: Rows, *, evaluations: int = EVALUATIONS, answers: int = ANSWERS
) -> Iterator[str]:
    """The lines of what is in a ledger already; none where a figure is missing."""
    names = _figures(evaluations, answers)
    if all(f"speed-{name}" in rows for name in names):
        for name in names:
            yield _line(name, rows)


def _figures(evaluations: int, answers: int) -> tuple[str, ...]:
    return (
        "archive",
        "fits-1",
        "fits-2",
        f"search-1-{evaluations}",
        f"search-2-{evaluations}",
        f"policy-{answers}",
    )


def _step(answers: int) -> str:
    return f"a step of the policy, {answers} answers".ljust(45)


def _line(name: str, rows: Rows) -> str:
    row = rows[f"speed-{name}"]
    if "answers" in row:
        sampling, update = row["sampling"], row["update"]
        parts = f"sampling {sampling:.1f} s, update {update:.1f} s"
        return f"{_step(row['answers'])} {sampling + update:7.1f} s         (target 60 s)  {parts}"
    if name == "archive":
        return (
            f"archive with 10,000 entries, sample + admit   {row['milliseconds']:7.3f} ms        "
            "(target 2 ms)"
        )
    if name == "fits-1":
        return f"fits, 13 states, this process                 {row['rate']:7.1f} a second"
    if name == "fits-2":
        ratio = row["rate"] / rows["speed-fits-1"]["rate"]
        return (
            f"fits, 13 states, two workers                  {row['rate']:7.1f} a second  (target "
            "15)   "
            f"{ratio:.2f} x (target 1.8 x)"
        )
    if row["workers"] == 1:
        return (
            f"search, one worker, {row['evaluations']:3d} evaluations           {row['rate']:7.1f} "
            "a second   "
            f"not fitting {row['overhead']:.1%} (target 5 %)"
        )
    ratio = row["rate"] / rows[f"speed-{name.replace('search-2', 'search-1')}"]["rate"]
    return (
        f"search, two workers, {row['evaluations']:3d} evaluations          {row['rate']:7.1f} a "
        "second  (target 15)   "
        f"{ratio:.2f} x (target 1.8 x)"
    )
