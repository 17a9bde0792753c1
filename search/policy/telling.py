"""How far a training is, in a line that is told now and then."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from search.display import choose_display, make_display

#: Told with the share that is done.
Tell = Callable[[str, float], None]
#: Seconds between plain lines.
EVERY = 10.0


@contextmanager
def telling(show: str = "auto") -> Iterator[Tell]:
    """Within, lines appear where the user looks, no more often than one can read; what is done always does.

    show : "terminal", "plain", "notebook", "silent", or "auto" for what suits.
    """
    way = choose_display(sys.stderr, sys.stdout) if show == "auto" else show
    display = make_display(way, sys.stderr, sys.stdout, EVERY)
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
