"""Ctrl-C, or a scheduler's SIGTERM, during a search: the first ends it after what is under way, the
second at once.
"""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

from ibrid.interrupts import hearing_interrupts
from ibrid_search.recursion.loop import Loop
from ibrid_search.recursion.progress import Progress


@contextmanager
def keyboard(loop: Loop, shown: Progress) -> Iterator[None]:
    """Ask the loop to stop at the first signal and say so, raise KeyboardInterrupt at the second;
    in the main thread alone.
    """

    def stop(*_: object) -> None:
        if loop.stop_asked:
            raise KeyboardInterrupt
        loop.stop_asked = True
        shown.say(
            "Finishing what is under way; a second Ctrl-C stops at once. Go on later with --resume."
        )

    with hearing_interrupts(stop, signal.SIGTERM):
        yield
