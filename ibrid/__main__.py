"""The command `ibrid`, also as `python -m ibrid`: an interrupt is no traceback, even while all is still being imported."""

import signal
import sys


def command() -> int:
    """Run the command line of this process; returns the exit status."""
    try:
        from ibrid.cli import main

        status = main()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all that is left is the end
    except KeyboardInterrupt:
        return 130
    return status


if __name__ == "__main__":
    sys.exit(command())
