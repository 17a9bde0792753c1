"""What a user's shell sees: wall time and peak memory of commands."""

import subprocess
import sys
import time

#: Runs the command line and says how much memory the process held at most (Linux).
_MEASURED = """
import sys
from ibrid.cli import main
try:
    status = main(sys.argv[1:])
except SystemExit as end:
    status = end.code
with open("/proc/self/status") as lines:
    peak = next(line for line in lines if line.startswith("VmHWM"))
print(peak.split()[1], file=sys.stderr)
sys.exit(status)
"""


def command_cost(arguments: list[str]) -> tuple[float, float]:
    """Seconds and peak resident megabytes of `ibrid ARGUMENTS` in a process of its own;
    RuntimeError when it fails.
    """
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _MEASURED, *arguments], capture_output=True, text=True, check=False
    )
    seconds = time.perf_counter() - started
    if done.returncode:
        raise RuntimeError(
            f"ibrid {' '.join(arguments)} ended with status {done.returncode}: {done.stderr[-500:]}"
        )
    return seconds, int(done.stderr.split()[-1]) / 1024
