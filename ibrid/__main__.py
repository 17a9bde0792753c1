"""The command `ibrid`, also as `python -m ibrid`: an interrupt is no traceback, even while all is
still being imported.
"""

import signal
import sys


def command() -> int:
    """Run the command line of this process; returns the exit status."""
    try:
        from ibrid.cli import main

        status = main()
    except KeyboardInterrupt:
        status = 130
    if hasattr(signal, "pthread_sigmask"):
        # All that is left is the end, in which Python would kill itself for an interrupt that an
        # import passed on.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    return status


if __name__ == "__main__":
    sys.exit(command())
