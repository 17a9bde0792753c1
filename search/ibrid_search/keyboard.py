"""Ctrl-C, or a scheduler's SIGTERM, during a search: the first ends it after what is under way, the second at once."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from ibrid_search.loop import Loop
from ibrid_search.progress import Progress


@contextmanager
def keyboard(loop: Loop, shown: Progress) -> Iterator[None]:
    """Ask the loop to stop at the first signal and say so, raise KeyboardInterrupt at the second; in the main thread alone."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        if loop.stop_asked:
            loop.halt_asked = True
            raise KeyboardInterrupt
        loop.stop_asked = True
        shown.say("Finishing what is under way; a second Ctrl-C stops at once. Go on later with --resume.")

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    except Exception:
        if loop.halt_asked:  # compiled code makes errors of its own of the interrupt
            raise KeyboardInterrupt from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
