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
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # all that is left is the end
    # Where an import passed an interrupt on, Python would kill itself at the end, and a thread of a
    # numerical library would not block that; it forgets the interrupt when it next runs text.
    exec("")
    return status


if __name__ == "__main__":
    sys.exit(command())
