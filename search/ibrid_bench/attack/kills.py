"""Searches killed by SIGKILL at random moments, one after the other, until each has ended; what the
archive lost by it.
"""

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibrid_search.run.store import Store

from ibrid.errors import IbridError

#: What a step is known by after a kill; times differ.
_KEPT = ("status", "program", "parent", "nrmse", "free", "hash")
#: Seconds that one process may take, and between looks at the archive.
PATIENCE, LOOK = 180.0, 0.05


@dataclass
class Kills:
    """`kills` : all of them; `later` : those after the first stored result.

    `lost` : what was stored and is not, or an answer that differs from that of a run that nobody
    killed, in sentences.
    """

    kills: int
    later: int
    lost: list[str]


def killed_runs(
    data: str,
    folder: Path,
    kills: int,
    seed: int,
    until: float,
    *,
    workers: int = 1,
    later: int = 0,
) -> Kills:
    """Kill runs until there were so many kills, `later` of them after the first stored result, or
    the time (monotonic, s) is up; the last run is carried to its end.
    """
    rng, found, number = random.Random(seed), Kills(0, 0, []), 0

    def wanted() -> bool:
        return (found.kills < kills or found.later < later) and time.monotonic() < until

    whole = folder / f"whole{workers}"
    if _status(_process(data, whole, workers)):
        return Kills(0, 0, [f"with {workers} workers not even a run that nobody kills ends"])
    truth = _steps(whole)
    while wanted():
        number += 1
        run = folder / f"run{workers}_{number}"
        ended = False
        while not ended:
            ended = (
                not _killed(data, run, workers, rng, found)
                if wanted()
                else _finished(data, run, workers, found)
            )
        if _steps(run) != truth:
            found.lost.append(
                f"run {number} with {workers} workers ends elsewhere than one that nobody killed"
            )
    return found


def _killed(data: str, run: Path, workers: int, rng: random.Random, found: Kills) -> bool:
    """Start or resume, and kill at a random moment; False when the run ended before."""
    before = _steps(run)
    process = _process(data, run, workers)
    # from the first moment on, or once something more is stored: with long starts most moments
    # would be before
    if rng.random() < 0.8:
        _await(process, lambda: len(_ended(_steps(run))) > len(_ended(before)))
    try:
        process.wait(rng.random() * 1.5)
    except subprocess.TimeoutExpired:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        found.kills += 1
        after = _steps(run)
        found.later += bool(_ended(after))
        _compare(before, after, found)
        return True
    if process.returncode:
        found.lost.append(f"{run.name} ends with {process.returncode}")
    return False


def _finished(data: str, run: Path, workers: int, found: Kills) -> bool:
    before = _steps(run)
    if _status(_process(data, run, workers)):
        found.lost.append(f"{run.name} cannot be gone on with")
    _compare(before, _steps(run), found)
    return True


def _compare(before: dict[int, Any], after: dict[int, Any], found: Kills) -> None:
    for number, step in _ended(before).items():
        if after.get(number) != step:
            found.lost.append(f"step {number} was {step}, now it is {after.get(number)}")


def _process(data: str, run: Path, workers: int) -> subprocess.Popen[bytes]:
    words = [
        "search",
        data,
        "--out",
        str(run),
        "--proposer",
        "rules",
        "--start",
        "naive",
        "--budget",
        "8",
        "--seed",
        "5",
    ]
    resume = (
        ["--resume"] if (run / "archive.sqlite").exists() or (run / "run.toml").exists() else []
    )
    command = [sys.executable, "-m", "ibrid", *words, "--workers", str(workers), *resume]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def _status(process: subprocess.Popen[bytes]) -> int:
    """Exit status; a process that takes longer than `PATIENCE` is killed."""
    try:
        return process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def _await(process: subprocess.Popen[bytes], seen: Any) -> None:
    started = time.monotonic()
    while process.poll() is None and not seen() and time.monotonic() - started < PATIENCE:
        time.sleep(LOOK)


def _steps(run: Path) -> dict[int, Any]:
    """Number -> what a step is known by; empty before there is an archive."""
    try:
        with Store.open(run / "archive.sqlite", read_only=True) as store:
            return {
                step.number: tuple(getattr(step, name) for name in _KEPT) for step in store.steps()
            }
    except IbridError:
        return {}


def _ended(steps: dict[int, Any]) -> dict[int, Any]:
    return {
        number: step for number, step in steps.items() if step[0] in ("ok", "failed", "required")
    }
