"""Binary files of others are read in a process of its own: what crashes, hangs or fills the memory
there is one sentence.
"""

import contextlib
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from zipfile import BadZipFile

import numpy as np

from ibrid.errors import SweepError
from ibrid.hanging import HangWatch, processor_seconds

#: Processor seconds that reading a file may take; looks at the process, every so many seconds, in a
#: row in which it did nothing.
COMPUTING, STILL, LOOK = 20, 6_000, 0.03
#: Bytes of memory that the process may take, and of answer that it may give, where the system keeps
#: to it.
MEMORY, ANSWER = 2 << 30, 64 << 20
#: Exit status of a process that understood that the file is damaged.
_DAMAGED = 3


def guarded(
    reader: Callable[[bytes], Mapping[str, np.ndarray]], content: bytes, what: str
) -> dict[str, np.ndarray]:
    """What a reader makes of the content of a file, read elsewhere.

    reader : a function of a module, from bytes to arrays of numbers or text by name; it may crash.
    what : how the sentence of an error begins: the file and what it must be.

    Raises SweepError where it raises, is killed, or takes more than the limits above. On Windows a
    crash and a hang are a sentence too, but the memory is not bounded.
    """
    command = [
        sys.executable,
        "-P",
        "-c",
        f"from {__name__} import serve; serve()",
        reader.__module__,
        reader.__name__,
    ]
    single = dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"
    )  # each thread reserves memory
    environment = {**os.environ, **single, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with tempfile.TemporaryFile() as given, tempfile.TemporaryFile() as answer:
        given.write(content)
        given.seek(0)
        try:
            process = subprocess.Popen(
                command, env=environment, stdin=given, stdout=answer, stderr=subprocess.DEVNULL
            )
        except OSError as reason:
            raise SweepError(
                f"{what}; no process can be started to read it ({reason.strerror})."
            ) from None
        with process:
            status = _status_of(process, what)
        answer.seek(0)
        if status == _DAMAGED:
            why = "".join(
                one if one.isprintable() else " "
                for one in answer.read(160).decode(errors="replace")
            )
            again = "" if "pip install" in why else ", save it again"
            raise SweepError(f"{what}; it cannot be read ({why}){again}.")
        with contextlib.suppress(
            OSError, ValueError, KeyError, EOFError, BadZipFile
        ):  # half an answer is none
            if not status:
                with np.load(io.BytesIO(answer.read(ANSWER)), allow_pickle=False) as held:
                    return {
                        str(name): held[f"value{number}"]
                        for number, name in enumerate(held["names"])
                    }
    raise SweepError(
        f"{what}; it ends the process that reads it, so it is damaged or huge: save it again."
    )


def _status_of(process: "subprocess.Popen[bytes]", what: str) -> int:
    """The exit status of the process once it ends; SweepError where it hangs, or the caller is
    interrupted.
    """
    watch = HangWatch(partial(processor_seconds, process.pid), 2 * COMPUTING, STILL, LOOK)
    try:
        while (status := process.poll()) is None:
            if why := watch.why_it_hangs():
                raise SweepError(f"{what}; reading it {why}, save the sweep alone.")
            time.sleep(LOOK)
    finally:
        process.kill()
    return status


def serve() -> None:
    """The other process: limit oneself, read standard input, write the arrays to standard
    output.
    """
    with contextlib.suppress(
        ImportError, ValueError, OSError
    ):  # Windows, or a lower limit of the user's
        import resource

        most = {"CORE": 0, "CPU": COMPUTING, "FSIZE": ANSWER, "AS": MEMORY}
        for name, limit in most.items():
            resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (limit, limit))
    reader = getattr(import_module(sys.argv[1]), sys.argv[2])
    stream, status = io.BytesIO(), 0
    try:
        arrays = reader(sys.stdin.buffer.read())
        values = {
            f"value{number}": np.asarray(value) for number, value in enumerate(arrays.values())
        }
        np.savez(stream, allow_pickle=False, names=np.array(list(arrays), dtype=str), **values)
        if len(stream.getbuffer()) > ANSWER:
            raise MemoryError
    except MemoryError:
        stream, status = io.BytesIO(b"it needs too much memory"), _DAMAGED
    except Exception as reason:  # whatever a library makes of a damaged file
        stream = io.BytesIO(
            (" ".join(str(reason).split()) or type(reason).__name__).encode(errors="replace")
        )
        status = _DAMAGED
    sys.stdout.buffer.write(stream.getbuffer())
    sys.stdout.flush()
    os._exit(
        status
    )  # at once: threads of Arrow crash one ordered end in five, which is not the file's fault
