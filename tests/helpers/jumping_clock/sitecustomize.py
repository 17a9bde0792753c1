"""A process that finds this file on its path has clocks that jump by an hour at each reading."""

import time

HOUR = 3600


def jumping(read, unit):
    """The clock `read`, an hour later at each reading; unit : of a second."""
    jumps = 0

    def later():
        nonlocal jumps
        jumps += 1
        return read() + jumps * HOUR * unit

    return later


for clock in ("time", "monotonic", "perf_counter", "process_time", "thread_time"):
    setattr(time, clock, jumping(getattr(time, clock), 1))
    setattr(time, f"{clock}_ns", jumping(getattr(time, f"{clock}_ns"), 10**9))
