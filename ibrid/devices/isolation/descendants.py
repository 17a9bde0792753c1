"""What a model began: processes that came from its own, whatever sessions and environments they
chose.
"""

import ctypes
import sys
from contextlib import suppress

import psutil

#: Seconds in which a process that was killed is gone.
ENDING_S = 10.0
#: PR_SET_CHILD_SUBREAPER of prctl(2).
_SET_CHILD_SUBREAPER = 36


def adopt_orphans() -> None:
    """Make this process the parent of every descendant whose own parent ends, so that it is found;
    Linux alone has this.
    """
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def end_descendants(pid: int) -> None:
    """End all processes that came from one; they are stopped first, so that none begins another one
    meanwhile.
    """
    stopped: dict[int, psutil.Process] = {}
    with suppress(psutil.Error, OSError):
        root = psutil.Process(pid)
        while family := [one for one in root.children(recursive=True) if one.pid not in stopped]:
            for process in family:
                stopped[process.pid] = process
                with suppress(psutil.Error, OSError):
                    process.suspend()
    end_processes(list(stopped.values()))


def end_with_descendants(pid: int) -> None:
    """Stop a process, so that it begins no others, end those that it began, then itself."""
    with suppress(psutil.Error, OSError):
        process = psutil.Process(pid)
        process.suspend()
        end_descendants(pid)
        process.kill()


def end_processes_with(variable: str, value: str) -> None:
    """End every process of ours whose environment says so: what a model that crashed left behind,
    unless it had an environment of its own.
    """
    marked = []
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if process.environ().get(variable) == value:
                marked.append(process)
    end_processes(marked)


def end_processes(processes: list[psutil.Process]) -> None:
    """Kill them and wait until they are gone, `ENDING_S` at most."""
    for process in processes:
        with suppress(psutil.Error, OSError):
            process.kill()
    psutil.wait_procs(processes, timeout=ENDING_S)
