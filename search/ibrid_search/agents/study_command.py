"""A command of ibrid that ends with the server that began it, however that ended: it keeps the
other end of standard input open.
"""

import os
import sys
import threading

from ibrid.cli import main
from ibrid.devices.isolation.descendants import end_descendants


def run() -> None:
    """Run the command of this process's words, with an empty standard input."""
    alive = os.dup(0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    threading.Thread(target=_end_with, args=[alive], daemon=True).start()
    sys.exit(main())


def _end_with(alive: int) -> None:
    """Wait until nobody holds the other end any more, and end with all that was begun."""
    while os.read(alive, 1):
        pass
    end_descendants(os.getpid())
    os._exit(1)
