"""A wall-clock limit that really stops a computation, where the operating system has an interval timer."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

#: A longer limit (s) is none: timers of the operating system do not count so far.
LONGEST = 1e8
#: The alarm comes back after so many seconds, where compiled code has swallowed the first.
AGAIN = 0.1
#: No alarm rings earlier (s): it must not ring before the block has begun. Shorter limits hold at the end of the block.
LEAST = 0.05


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in the block after `seconds`.

    In the main thread of a POSIX system an alarm interrupts Python code of any kind; elsewhere (another thread, Windows)
    only the limits that the fit checks between its own steps hold.
    """
    usable = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    if not usable or not 0 < seconds <= LONGEST:
        yield
        return

    over = armed = False

    def stop(*_: object) -> None:
        nonlocal over
        over = True
        if armed:
            raise TimeoutError(f"stopped after {seconds:g} s")

    began = time.monotonic()
    before = signal.signal(signal.SIGALRM, stop)
    outer, interval = signal.getitimer(signal.ITIMER_REAL)
    first = min(seconds, outer) if outer > 0 else seconds  # an earlier alarm of the caller stops this block too
    signal.setitimer(signal.ITIMER_REAL, max(first, LEAST), AGAIN)
    try:
        try:
            armed = True
            yield
        finally:
            armed = False
    except TimeoutError:
        raise
    except BaseException as error:  # compiled code wraps what is raised inside it
        if not over:
            raise
        raise TimeoutError(f"stopped after {seconds:g} s") from error
    finally:
        armed = False  # once more: the alarm may have rung on the line above
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        if outer > 0:  # an alarm of the caller goes on, or rings now
            signal.setitimer(signal.ITIMER_REAL, max(outer - (time.monotonic() - began), 1e-6), interval)
    if over or time.monotonic() - began > seconds:  # a limit below `LEAST` has no alarm of its own
        raise TimeoutError(f"stopped after {seconds:g} s")
