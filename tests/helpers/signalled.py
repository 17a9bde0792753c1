"""Commands of ibrid in a process group of their own, signalled when they have worked for so long,
as a terminal does it.
"""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import psutil

#: Seconds of a pause, of looks at how far a command is, and that an interrupted one may take to
#: end.
PAUSE, LOOK, PATIENCE = 13.0, 0.005, 300.0


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    `worked` : processor seconds. `left` : processes of its own that are still there.
    """

    status: int
    out: str
    err: str
    worked: float
    left: tuple[int, ...]


def signalled(
    words: list[str], folder: Path, *, after: float, number: int = signal.SIGINT, path: str = ""
) -> Ended:
    """Run a command line, and signal its process group once it has taken so many processor seconds.

    A SIGSTOP is followed by a SIGCONT after `PAUSE` seconds. path : of Python, where it is another
    than here.
    """
    environment = {**os.environ, "PYTHONPATH": path or os.pathsep.join(filter(None, sys.path))}
    with (folder / ".out").open("w+") as out, (folder / ".err").open("w+") as err:
        process = subprocess.Popen(
            words,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
        worked, seen = 0.0, psutil.Process(process.pid)
        while process.poll() is None and worked < after:
            worked = max(worked, _processor_seconds(seen))
            time.sleep(LOOK)
        if process.poll() is None:
            os.killpg(process.pid, number)
            if number == signal.SIGSTOP:
                time.sleep(PAUSE)
                os.killpg(process.pid, signal.SIGCONT)
        status = process.wait(PATIENCE)
        out.seek(0)
        err.seek(0)
        return Ended(status, out.read(), err.read(), worked, _of_session(process.pid))


def _processor_seconds(process: psutil.Process) -> float:
    try:
        times = process.cpu_times()
    except psutil.Error:
        return 0.0
    return times.user + times.system


def _of_session(session: int) -> tuple[int, ...]:
    return tuple(pid for pid in psutil.pids() if _session_of(pid) == session)


def _session_of(pid: int) -> int | None:
    try:
        return os.getsid(pid)
    except OSError:
        return None
