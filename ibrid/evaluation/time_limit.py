"""A wall-clock limit that really stops a computation, where the operating system has an interval timer."""

import signal
import threading
import time
from contextlib import AbstractContextManager
from types import FrameType

#: A longer limit (s) is none: timers of the operating system do not count so far.
LONGEST = 1e8
#: The alarm comes back after so many seconds, where compiled code has swallowed the first.
AGAIN = 0.1
#: No alarm rings earlier (s): it must not ring before the block has begun. Shorter limits hold at the end of the block.
LEAST = 0.05


class time_limit(AbstractContextManager[None]):
    """Raise TimeoutError in the block after `seconds`.

    In the main thread of a POSIX system an alarm interrupts Python code of any kind; elsewhere (another thread, Windows)
    only the limits that the fit checks between its own steps hold. An alarm that rings while the block is being left
    waits, so that leaving it is whole.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._over = self._usable = False

    def __enter__(self) -> None:
        main = threading.current_thread() is threading.main_thread()
        self._usable = hasattr(signal, "setitimer") and main and 0 < self._seconds <= LONGEST
        if self._usable:
            self._began = time.monotonic()
            self._before = signal.signal(signal.SIGALRM, self._stop)
            self._outer, self._interval = signal.getitimer(signal.ITIMER_REAL)
            # an earlier alarm of the caller stops this block too
            first = min(self._seconds, self._outer) if self._outer > 0 else self._seconds
            signal.setitimer(signal.ITIMER_REAL, max(first, LEAST), AGAIN)

    def _stop(self, _: int, frame: FrameType | None) -> None:
        self._over = True
        while frame is not None:
            if frame.f_code in (time_limit.__enter__.__code__, time_limit.__exit__.__code__):
                return
            frame = frame.f_back
        raise TimeoutError(f"stopped after {self._seconds:g} s")

    def __exit__(self, kind: object, error: BaseException | None, _: object) -> None:
        if not self._usable:
            return
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)  # drops one under way
        signal.signal(signal.SIGALRM, self._before)
        spent = time.monotonic() - self._began
        if self._outer > 0:  # an alarm of the caller goes on, or rings now
            signal.setitimer(signal.ITIMER_REAL, max(self._outer - spent, 1e-6), self._interval)
        # compiled code wraps what is raised inside it; a limit below `LEAST` has no alarm of its own
        if not isinstance(error, TimeoutError) and (self._over or (error is None and spent > self._seconds)):
            raise TimeoutError(f"stopped after {self._seconds:g} s") from error
