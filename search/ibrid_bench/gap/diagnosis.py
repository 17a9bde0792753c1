"""The blind part: another process is given a model and a measurement, and nothing else; its files
are the answer.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ibrid.commands.outputs import UNFINISHED
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record, read_record

#: Run inside the folder of a case: no path leads out of it. -P: the folder's model.py is no module
#: to be imported.
COMMAND = (
    *(sys.executable, "-P", "-m", "ibrid", "gap"),
    *("model.py", "sweep.csv", "--values", "nominal.json", "--out", "answer"),
)
#: Seconds after which a diagnosis is ended and counts as failed.
LIMIT = 900.0


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """An answer. `gap` : gap.json, {} when there is none, then `failure` says why. `record` : of
    the repaired model.
    `seconds` : of the whole process.
    """

    gap: Mapping[str, Any]
    record: Record | None
    seconds: float
    failure: str = ""


Diagnose = Callable[[Path], Diagnosis]


def diagnose(folder: Path, *, command: Sequence[str] = COMMAND, limit: float = LIMIT) -> Diagnosis:
    """Let a process of its own answer a case in `folder`, on one core.

    Never raises for what that process does.
    """
    began = time.perf_counter()
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=limit,
        )
    except subprocess.TimeoutExpired:
        return Diagnosis({}, None, limit, f"no answer within {limit:g} s")
    seconds = time.perf_counter() - began
    if done.returncode not in (0, UNFINISHED):
        lines = done.stderr.strip().splitlines() or ["no word"]
        return Diagnosis({}, None, seconds, f"exit status {done.returncode}: {lines[-1]}")
    return _read(folder / "answer", seconds)


def _read(folder: Path, seconds: float) -> Diagnosis:
    try:
        gap = json.loads((folder / "gap.json").read_text(encoding="utf-8"))
        return Diagnosis(gap, read_record(folder / "model.json"), seconds)
    except (OSError, ValueError, IbridError) as error:
        return Diagnosis({}, None, seconds, f"the answer cannot be read: {error}")
