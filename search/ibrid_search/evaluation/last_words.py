"""What a user reads when the process of a search ends before it can say anything: Ray ends it with its node, a scheduler by
SIGKILL. A small process of Python waits at a pipe for a goodbye, and tells where none comes.
"""

import subprocess
import sys
from contextlib import suppress

BROKEN_OFF = (
    "ibrid: the search broke off: its process was killed, or ended together with Ray's node; every evaluation that was "
    "stored is kept, go on with the same command and --resume"
)
_WAIT = f"import signal, sys\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\nsys.stdin.read(1) or print({BROKEN_OFF!r})"


class LastWords:
    """Tells on standard error that the search broke off, unless `goodbye` comes first."""

    def __init__(self) -> None:
        self._waiting = subprocess.Popen(
            [sys.executable, "-S", "-E", "-c", _WAIT], stdin=subprocess.PIPE, stdout=2, close_fds=True
        )

    def goodbye(self) -> None:
        """The search ends as it should. Again does nothing."""
        with suppress(OSError, ValueError):
            self._waiting.communicate(b"!", timeout=10)
