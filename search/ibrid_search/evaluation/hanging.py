"""The safety net under a worker process: what hangs is seen from outside, by the processor time that the system counts for it.

It is no budget: an evaluation ends by itself, after so many steps. Other work on the machine changes nothing here.
"""

from dataclasses import dataclass, field

import psutil

from ibrid.errors import IbridError

#: Processor seconds of one job, far beyond what any takes.
PROCESSOR_LIMIT = 1800.0
#: Seconds between two looks at a process, and looks in a row in which it used no processor time, after which it hangs.
LOOK, STILL = 1.0, 600


@dataclass
class HangWatch:
    """Looks at a process while it works on one job. `limit` : processor seconds. `still` : as `STILL`."""

    pid: int
    limit: float = PROCESSOR_LIMIT
    still: int = STILL
    _begun: float = field(init=False)
    _used: float = field(init=False, default=0.0)
    _idle: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._begun = processor_seconds(self.pid)

    def hangs(self) -> str:
        """Why the process hangs, as the end of a sentence about it; empty where it does not, or is gone."""
        used = processor_seconds(self.pid) - self._begun
        self._idle = self._idle + 1 if used <= self._used else 0
        self._used = max(used, self._used)
        if used > self.limit:
            return f"took more than {self.limit:g} s of processor time"
        return f"did nothing for {self.still} s" if self._idle >= self.still else ""


def require_limit(limit: float) -> None:
    """Raise IbridError for a limit that means nothing."""
    if not limit > 0:
        raise IbridError(f"processor_limit must be above 0 s, found {limit:g}")


def processor_seconds(pid: int) -> float:
    """What the system has counted for a process; 0 where it is gone."""
    try:
        times = psutil.Process(pid).cpu_times()
    except psutil.Error:
        return 0.0
    return times.user + times.system
