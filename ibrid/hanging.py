"""The safety net under a process of ours: one that hangs is seen from outside, by the processor
time that the system counts.

It is no budget: work ends by itself, after so many steps. A process hangs that takes far more
processor time than any work does, or next to none for many looks in a row, which one that waits for
its turn on a busy machine does not.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import psutil

from ibrid.errors import IbridError

#: Processor seconds of one job, far beyond what any takes.
PROCESSOR_LIMIT = 1800.0
#: Seconds between two looks at a process, and looks in a row after which one that does nothing
#: hangs.
LOOK, STILL = 1.0, 600
#: Part of a core below which a process does nothing: what keeps it in touch with others takes
#: 0.003.
IDLE = 0.01


@dataclass
class HangWatch:
    """Looks at a process while it works on one job.

    `used` : the processor seconds that it has taken since it began. `limit` : those that the job
    may take. `still` : looks in a row, every `look` seconds, in which it did nothing.
    """

    used: Callable[[], float]
    limit: float = PROCESSOR_LIMIT
    still: int = STILL
    look: float = LOOK
    _begun: float = field(init=False)
    _worked: float = field(init=False)  # what it had taken when it was last seen at work
    _idle: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        if not self.limit > 0:
            raise IbridError(f"a limit of processor time must be above 0 s, found {self.limit:g}")
        self._begun = self.used()
        self._worked = self._begun

    def why_it_hangs(self) -> str:
        """Why the process hangs, as the end of a sentence about it; empty where it does not, or is
        gone.
        """
        used = self.used()
        self._idle += 1
        if used - self._worked >= IDLE * self.look * self._idle:
            self._worked = used
            self._idle = 0
        if used - self._begun > self.limit:
            return f"took more than {self.limit:g} s of processor time"
        return f"did nothing in {self.still} looks" if self._idle >= self.still else ""


def processor_seconds(pid: int) -> float:
    """What the system has counted for a process; 0 where it is gone."""
    try:
        times = psutil.Process(pid).cpu_times()
    except psutil.Error:
        return 0.0
    return times.user + times.system
