"""A device in a process of its own: what crashes or hangs there is one sentence here, and nothing
is left running.
"""

import os
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, cast

import numpy as np

from ibrid.devices.describing import Description
from ibrid.devices.device_file import DeviceFile
from ibrid.devices.isolation.child import NOTHING, Message, plain_device, receive, send
from ibrid.devices.isolation.descendants import (
    ENDING_S,
    end_processes_with,
    end_with_descendants,
)
from ibrid.errors import IbridError
from ibrid.hanging import HangWatch, processor_seconds


@dataclass(frozen=True)
class ProcessLimits:
    """When a process hangs (`ibrid.hanging`), while it answers one question. processor_s : seconds
    of processor time at most.
    still : looks in a row, every look_s seconds, in which it did nothing.
    """

    processor_s: float = 300.0
    still: int = 600
    look_s: float = 0.1


#: The usual ones.
NO_HURRY = ProcessLimits()


class ModelProcess:
    """A process that runs a model file of somebody else. Use it in a `with`, which ends it.

    what : the file, for sentences. Raises IbridError where no process can be started.
    """

    def __init__(self, what: str, limits: ProcessLimits) -> None:
        self._what = what
        self._limits = limits
        self._answers: SimpleQueue[Message | None] = SimpleQueue()
        command = [
            sys.executable,
            "-P",
            "-c",
            "from ibrid.devices.isolation.child import serve; serve()",
        ]
        single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        self._folder = TemporaryDirectory(
            prefix=f"ibrid-{os.getpid()}-", ignore_cleanup_errors=True
        )
        temporary = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), self._folder.name)
        path = os.pathsep.join(filter(None, sys.path))
        environment = {**os.environ, **single, **temporary, "PYTHONPATH": path}
        pipe, nowhere = subprocess.PIPE, subprocess.DEVNULL
        try:
            self._process = subprocess.Popen(
                command,
                env=environment,
                stdin=pipe,
                stdout=pipe,
                stderr=nowhere,
                start_new_session=True,  # so that an interrupt of the terminal is ours to tell
            )
        except OSError as error:
            self._folder.cleanup()
            raise IbridError(
                f"{what}: no process can be started to run it ({error.strerror})"
            ) from None
        threading.Thread(target=self._listen, daemon=True).start()

    def __enter__(self) -> "ModelProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process and those that it began, and take its temporary files away."""
        end_with_descendants(self._process.pid)
        self._process.kill()
        self._process.wait()
        end_processes_with("TMPDIR", self._folder.name)
        with suppress(OSError):  # what was written and never read
            cast(BinaryIO, self._process.stdin).close()
        self._folder.cleanup()

    def ask(self, line: dict[str, Any], numbers: np.ndarray = NOTHING) -> Message:
        """What the process answers.

        Raises IbridError, one sentence with the file, where the model fails, crashes or hangs.
        """
        with suppress(OSError):  # the process ended; why, the queue tells
            send(cast(BinaryIO, self._process.stdin), line, numbers)
        answer = self._awaited()
        if answer is None:
            raise IbridError(
                f"{self._what}: crashed, its process {self._ending()}; see whether its own "
                "simulator runs it"
            )
        told, _ = answer
        if "error" in told:
            sentence = str(told["error"])
            raise IbridError(sentence if self._what in sentence else f"{self._what}: {sentence}")
        return answer

    def _awaited(self) -> Message | None:
        """The next answer; None where the process ended."""
        used = partial(processor_seconds, self._process.pid)
        watch = HangWatch(used, self._limits.processor_s, self._limits.still, self._limits.look_s)
        while True:
            try:
                return self._answers.get(timeout=self._limits.look_s)
            except Empty:
                why = watch.why_it_hangs()
            if why:
                end_with_descendants(self._process.pid)
                raise IbridError(
                    f"{self._what}: hangs, its process {why}; look for a loop without end in the "
                    "model"
                )

    def _listen(self) -> None:
        """Hand on what the process answers; None where it ended."""
        message: Message | None = None
        with cast(BinaryIO, self._process.stdout) as stream:
            while True:
                try:
                    message = receive(stream)
                except (ValueError, MemoryError, OSError):  # no answer of ours
                    message = None
                self._answers.put(message)
                if message is None:
                    return

    def _ending(self) -> str:
        """What it did, as the end of a sentence: ended with a signal, on POSIX, or exit status."""
        try:
            status = self._process.wait(timeout=ENDING_S)
        except subprocess.TimeoutExpired:
            return "closed what it answers on"
        return f"ended with signal {-status}" if status < 0 else f"ended with exit status {status}"


class ProcessDevice:
    """A `TerminalDevice` that lives in a process of its own, which `close` ends.

    Raises IbridError as `ModelProcess.ask`, and where the device answers no numbers.
    """

    def __init__(self, device: DeviceFile, limits: ProcessLimits = NO_HURRY) -> None:
        self._what = device.file
        self._step_s = device.step_s
        self._process = ModelProcess(device.file, limits)
        try:
            self._process.ask({"open": plain_device(device)})
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def put(self, reference: str, value: float) -> None:
        self._process.ask({"put": {reference: value}})

    def move(self, reference: str, value: float) -> None:
        self._process.ask({"move": {reference: value}})

    def play(self, first: int, v: np.ndarray) -> np.ndarray:
        _, i = self._process.ask({"first": first, "step_s": self._step_s}, v)
        if i.shape != v.shape:
            raise IbridError(
                f"{self._what}: answered {len(i)} samples where {len(v)} were asked for; something "
                "in the model writes where its answers go, let it write to files of its own"
            )
        return i

    def files_read(self) -> list[str]:
        """Paths of the files that the model was made of so far."""
        answer, _ = self._process.ask({"files": True})
        files = answer.get("files")
        if not (isinstance(files, list) and all(isinstance(file, str) for file in files)):
            raise _other_answer(self._what)
        return files


def described(file: str | Path) -> Description:
    """What a model file offers; its code runs in a process of its own.

    Raises IbridError for a file that is no model.
    """
    with ModelProcess(str(file), NO_HURRY) as process:
        answer, _ = process.ask({"describe": str(Path(file).absolute())})
    try:
        return Description(**answer["described"])
    except (KeyError, TypeError):
        raise _other_answer(str(file)) from None


def _other_answer(what: str) -> IbridError:
    return IbridError(
        f"{what}: answered something else than was asked; something in the model writes where its "
        "answers go, let it write to files of its own"
    )
