"""How far some work is, in a line that is told now and then where the user looks."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ibrid.display import make_display

#: Told what is going on, and the share that is done.
Tell = Callable[[str, float], None]
#: Seconds between plain lines.
EVERY = 10.0


def silent(words: str, share: float) -> None:
    """Tell nobody, where no progress is wanted."""


@contextmanager
def telling(show: str | Tell = "auto") -> Iterator[Tell]:
    """Within, lines appear where the user looks, no more often than one can read; what is done
    always does.

    show : "terminal", "plain", "notebook", "silent", or "auto" for what suits; or who is told
    everything.

    Raises IbridError for any other word.
    """
    if callable(show):
        yield show
        return
    display = make_display(show, sys.stderr, sys.stdout, EVERY)
    shown = -float("inf")

    def tell(text: str, share: float) -> None:
        nonlocal shown
        now = time.monotonic()
        if now - shown >= display.pause or share >= 1:
            display.state(text, share)
            shown = now

    try:
        yield tell
    finally:
        display.close()
