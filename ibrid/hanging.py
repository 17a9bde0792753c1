"""The safety net under a process of ours: one that hangs is seen from outside, by the processor time that the system counts.

It is no budget: work ends by itself, after so many steps. Other work on the machine changes nothing here.
"""

from dataclasses import dataclass, field

import psutil

from ibrid.errors import IbridError

#: Processor seconds of one job, far beyond what any takes.
PROCESSOR_LIMIT = 1800.0
#: Seconds between two looks at a process, and looks in a row without any processor time after which it hangs.
LOOK, STILL = 1.0, 600


@dataclass
class HangWatch:
    """Looks at a process while it works on one job. `limit` : processor seconds. `still` : looks in a row, every `look` seconds,
    in which it did nothing."""

    pid: int
    limit: float = PROCESSOR_LIMIT
    still: int = STILL
    look: float = LOOK
    _begun: float = field(init=False)
    _used: float = field(init=False, default=0.0)
    _idle: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        if not self.limit > 0:
            raise IbridError(f"a limit of processor time must be above 0 s, found {self.limit:g}")
        self._begun = processor_seconds(self.pid)

    def why_it_hangs(self) -> str:
        """Why the process hangs, as the end of a sentence about it; empty where it does not, or is gone."""
        used = processor_seconds(self.pid) - self._begun
        self._idle = self._idle + 1 if used <= self._used else 0
        self._used = max(used, self._used)
        if used > self.limit:
            return f"took more than {self.limit:g} s of processor time"
        return f"did nothing for {self.still * self.look:g} s" if self._idle >= self.still else ""


def processor_seconds(pid: int) -> float:
    """What the system has counted for a process; 0 where it is gone."""
    try:
        times = psutil.Process(pid).cpu_times()
    except psutil.Error:
        return 0.0
    return times.user + times.system
